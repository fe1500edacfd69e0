"""The Python of README.md, of the package's page and of the book, run as it is shown."""

from pathlib import Path

import pytest

import cairn
import runtime

OWN = [runtime.ROOT / "README.md", runtime.ROOT / "bindings" / "python" / "README.md"]
BOOK = runtime.ROOT / "docs"


def blocks(page: Path) -> list[str]:
    """The Python that a page shows."""
    return [part.split("```")[0] for part in page.read_text(encoding="utf-8").split("```python\n")[1:]]


@pytest.mark.parametrize("page", OWN, ids=lambda page: page.parent.name)
def test_the_pages_examples_run(page, capsys):
    runtime.need_library()
    picture = runtime.pattern(90, 160)
    with cairn.Device.cpu(threads=2) as device:
        names = {
            "cairn": cairn,
            "device": device,
            "path": runtime.need_worlds() / "tiny",
            "script": runtime.ROOT / "samples" / "scripts" / "walk.txt",
            "picture": picture,
            "seed": picture,
        }
        shown = blocks(page)
        for block in shown:
            # Blocks run in the page's order.
            exec(compile(block, str(page), "exec"), names)
            names["device"] = device
    assert shown and len(capsys.readouterr().out.splitlines()) == 15
    if "film" in names:
        assert len(names["shown"]) == 16 and {"anchor", "decoded"} <= set(names["shown"])
        assert len(names["film"]) == 60 and names["film"][0].shape == (72, 128, 4) and len(names["state"]) > 0


PAGES = sorted(page for page in BOOK.rglob("*.md") if blocks(page))


def test_the_book_shows_python():
    assert BOOK / "quick-start" / "python.md" in PAGES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_books_examples_run_alone(page, capsys):
    runtime.need_library()
    names = {}
    for block in blocks(page):
        # Only files that the previous blocks made.
        exec(compile(block, str(page), "exec"), names)
        assert capsys.readouterr().out

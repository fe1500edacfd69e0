"""A user's first walk with an installed wheel, from an otherwise empty folder: the package finds the library and ONNX Runtime without settings.

    python walk.py FOLDER     writes a strip of pictures there
"""

import asyncio
import os
import sys
from pathlib import Path

import numpy as np

import cairn
from cairn import _library, _onnxruntime

WALK = [cairn.Controls(keys=["W"], mouse=(4, 0))] * 3


def test(name: str, right: bool) -> None:
    """Prints one line for the test runner."""
    print(f"test {name} ... {'ok' if right else 'FAILED'}", flush=True)


async def awaited(world: cairn.World, seed: np.ndarray) -> tuple[list[np.ndarray], int]:
    """Pictures of a walk, and how often the event loop ran meanwhile."""
    rounds = 0

    async def count() -> None:
        nonlocal rounds
        while True:
            rounds += 1
            await asyncio.sleep(0)

    counting = asyncio.create_task(count())
    with world.rollout(seed=5) as rollout:
        await rollout.append_async(seed)
        pictures = [anchor.picture() async for anchor in rollout.play_async(WALK)]
    counting.cancel()
    return pictures, rounds


def main(folder: Path) -> None:
    package = Path(cairn.__file__).resolve().parent
    test("the library is the one in the package", _library.library().path == package / _library.FILE)
    runtime = _onnxruntime.in_package()
    test("ONNX Runtime is the one in its package", runtime is not None and runtime.parent.parts[-2:] == ("onnxruntime", "capi"))
    found = [requirement.found for requirement in cairn.requirements() if requirement.what == "onnxruntime"]
    # Windows has several spellings of one path.
    test("and it is what a device would load", bool(found) and runtime is not None and runtime.name in found[0])
    y, x = np.mgrid[0:90, 0:160]
    seed = np.stack([x, 2 * y, (x // 8 + y // 8) % 2 * 200], axis=2).astype(np.uint8)
    with cairn.Device.cpu(threads=2) as device, device.load_world() as world:
        with world.rollout(seed=5) as rollout:
            rollout.append(seed)
            pictures = []
            for controls in WALK:
                rollout.step(controls)
                pictures.append(rollout.anchor().picture())
        test("a walk has pictures", len(pictures) == 3 and all(np.ptp(picture) > 20 for picture in pictures))
        same, rounds = asyncio.run(awaited(world, seed))
        test("the same walk, awaited, has the same pictures", len(same) == 3 and all(map(np.array_equal, same, pictures)))
        test("and the loop went on meanwhile", rounds > 3)
    film = cairn.Film(pictures, 15)
    shown = film._repr_mimebundle_()
    test("a notebook can show it", bytes(shown["image/png"]).startswith(b"\x89PNG"))
    film.strip().save(folder / "a strip Ж.png")
    test("and it can be kept", (folder / "a strip Ж.png").stat().st_size > 1000)


if __name__ == "__main__":
    place = Path(sys.argv[1]).resolve()
    if sys.platform == "win32":
        # A drive without any of the project's files.
        os.chdir("C:\\")
    main(place)

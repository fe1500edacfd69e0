"""Estimated rates: their arithmetic, and that the pages show them."""

import re
from dataclasses import replace

import pytest
from conftest import ROOT, TINY

from cairn.build import PRESETS, archive, rates
from cairn.build.cli import main
from cairn.build.published import POINTS
from cairn.build.writer import build_graphs

SHOWN = "samples/worlds/miniature.cairn --preset 360p --preset 720p"


@pytest.fixture(scope="module")
def worlds():
    """Those of the pages, named as the command names them."""
    bundle = ROOT / "samples" / "worlds" / "miniature.cairn"
    shapes = {bundle.stem: archive.read_geometry(bundle)} | {name: PRESETS[name][1] for name in ("360p", "720p")}
    return [rates.World(name, g) for name, g in shapes.items()]


@pytest.mark.parametrize("window", [TINY.global_window, TINY.global_max_window])
def test_products_of_a_pass_are_those_of_the_architecture(window):
    g = TINY
    tokens, width, hidden = g.tokens, g.width, g.width * g.mlp_ratio
    # Patch embedding and its inverse, the conditioner and its modulations, the controls, and the last norm.
    wanted = 2 * tokens * width * g.patch_width + 512 * 4 * width + 4 * width * width
    wanted += g.layers * 6 * width * width + g.control_width * hidden + hidden * width + 2 * width * width
    for i in range(g.layers):
        keys = g.past_tokens(i, window) + tokens
        wanted += 2 * tokens * width * (width + g.kv_width + hidden) + 2 * g.heads * tokens * keys * g.head_width
        wanted += (2 * tokens + 1) * width * width if g.sees_controls(i) else 0
    assert rates.multiply_adds(build_graphs(g, "f32")["transformer"], g.dimensions(window)) == wanted


def test_products_of_the_decoder_are_those_of_the_architecture(worlds):
    for world in worlds:
        g = world.geometry
        widths, rows, columns, frames = g.decoder_widths, g.latent_height, g.latent_width, 1
        wanted = rows * columns * 9 * g.latent_channels * widths[0]
        for width, following, grown in zip(widths, widths[1:], (1, 2, 2)):
            # Three blocks, each of three convolutions over a frame and its predecessor.
            wanted += frames * rows * columns * 3 * 9 * (2 * width * width + width * width + width * width)
            # A 1 x 1 convolution makes several frames of one; then each pixel becomes 2 x 2.
            wanted += frames * rows * columns * width * grown * width
            frames, rows, columns = frames * grown, 2 * rows, 2 * columns
            wanted += frames * rows * columns * 9 * width * following
        # 2 x 2 pixels of three colours.
        wanted += frames * rows * columns * 9 * widths[-1] * 12
        assert world.decode.flops == 2 * wanted, world.name


def test_presets_match_the_library():
    text = (ROOT / "src" / "world" / "preset.rs").read_text(encoding="utf-8")
    of_stock = len(TINY.schedule) - 1
    for preset in rates.PRESETS_OF_THE_LIBRARY:
        row = re.search(rf"Self::{preset.name.capitalize()} => \((\d+), Schedule::(?:Refined\((\d+)\)|Stock)", text)
        assert row, preset.name
        assert (int(row[1]), int(row[2] or of_stock) + 1) == (preset.window, preset.passes), preset.name


def test_faster_memory_and_faster_arithmetic_each_help_where_they_are_short(worlds):
    world, stock = worlds[1], rates.PRESETS_OF_THE_LIBRARY[0]
    slow = rates.Gpu("slow", 10, 1000, 24)
    assert world.limit(rates.Gpu("", 20, 1000, 24), stock) > 1.9 * world.limit(slow, stock)
    assert world.limit(rates.Gpu("", 10, 2000, 24), stock) == world.limit(slow, stock)
    starved = rates.Gpu("starved", 1000, 10, 24)
    assert world.limit(rates.Gpu("", 1000, 20, 24), stock) > 1.9 * world.limit(starved, stock)
    low, high = world.estimate(slow, stock)
    assert 0 < low < high < world.limit(slow, stock)
    assert not world.fits(rates.Gpu("small", 1000, 1000, 3), stock)


def test_sixteen_bit_points_lie_within_their_limits_and_bound_the_estimate():
    of_16 = [point for point in POINTS if point.bits == 16]
    reached = {point: point.rate / rates.limit_of(point) for point in of_16}
    assert all(0 < share < 1 for share in reached.values()), reached
    assert rates.shares() == (min(reached.values()), max(reached.values()))
    # A published rate of a GPU and model of the page lies in its own range.
    stock = rates.PRESETS_OF_THE_LIBRARY[0]
    for point in of_16:
        gpu = next(gpu for gpu in (*rates.GPUS, *rates.GPUS_OF_POINTS) if gpu.name == point.gpu)
        low, high = rates.World(point.model, PRESETS[point.model][1]).estimate(gpu, stock)
        assert low * 0.999 <= point.rate <= high * 1.05, point
    assert rates.fast_kernel_seconds() < rates.SLOW_KERNEL_SECONDS


def test_eight_bit_points_do_not_widen_the_range(monkeypatch):
    before = rates.shares()
    faster = replace(next(point for point in POINTS if point.bits == 8), rate=1000.0)
    for extra, wanted in ((faster, before), (replace(faster, bits=16), (before[0], 1000.0 / rates.limit_of(faster)))):
        monkeypatch.setattr(rates, "POINTS", (*POINTS, extra))
        rates.shares.cache_clear()
        assert rates.shares() == wanted
    monkeypatch.undo()
    rates.shares.cache_clear()


def test_a_shorter_history_and_no_decoder_raise_the_limit():
    point = next(point for point in POINTS if point.latents)
    assert rates.limit_of(point) > rates.limit_of(replace(point, latents=0))
    assert rates.limit_of(replace(point, decoder=False)) > rates.limit_of(point)


def test_bold_needs_real_time_at_the_low_end(worlds):
    rows = [line for line in rates.table(worlds).splitlines() if " to " in line]
    assert len(rows) == len(worlds) * len(rates.GPUS)
    for cell in (cell for row in rows for cell in row.split(" | ")[1:] if " to " in cell):
        low = float(cell.strip("*| ").split(" to ")[0])
        assert cell.startswith("**") == (low >= rates.REAL_TIME), cell


def test_the_pages_show_the_estimates(worlds):
    page, readme = ((ROOT / name).read_text(encoding="utf-8") for name in ("docs/rates.md", "README.md"))
    why = f"make it again: python -m cairn.build rates {SHOWN}"
    assert rates.table(worlds).strip() in page, why
    assert rates.summary(worlds) in readme, f"{why} --summary"
    assert rates.evidence() in page, f"{why} --points"
    worst, best = (f"{100 * share:.0f} %" for share in rates.shares())
    assert f"rates {SHOWN}" in page and f"from {worst} to {best} of the limit" in page
    assert f"{1e6 * rates.fast_kernel_seconds():.1f} microseconds" in page
    stock, *_, slowest = rates.PRESETS_OF_THE_LIBRARY
    in_time = [[bound >= rates.REAL_TIME for gpu in rates.GPUS for bound in world.estimate(gpu, stock)] for world in worlds[1:]]
    lows, highs = ([sum(world[start::2]) for world in in_time] for start in (0, 1))
    assert f"At the high end, {highs[0]} of the {len(rates.GPUS)} GPUs run the 360P model" in page
    assert highs[1] == 0 and lows == [0, 0], "the sentence after it"
    assert f"{1e6 / (rates.REAL_TIME * worlds[0].kernels(slowest)):.1f} microseconds" in page


def test_the_command_names_what_is_missing(capsys, tiny):
    assert main(["rates"]) == 2
    assert "--preset 360p" in capsys.readouterr().err
    assert main(["rates", str(tiny), "--summary"]) == 0
    assert "GeForce" in capsys.readouterr().out
    assert main(["rates", "--points"]) == 0
    assert "H100" in capsys.readouterr().out

"""Estimated rates and those measured in reports: their arithmetic, and that the pages show them."""

import json
import re
from dataclasses import replace

import pytest
from conftest import ROOT, TINY

from cairn.build import PRESETS, archive, measured, rates
from cairn.build.cli import main
from cairn.build.conditioning import CONTROLS
from cairn.build.errors import BuildError
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
    # Patch embedding and its inverse; the conditioning is no part of a pass.
    wanted = 2 * tokens * width * g.patch_width
    of_controls = g.control_width * hidden + hidden * width
    for i in range(g.layers):
        keys = g.past_tokens(i, window) + tokens
        wanted += 2 * tokens * width * (width + g.kv_width + hidden) + 2 * g.heads * tokens * keys * g.head_width
        wanted += 2 * tokens * width * width if g.sees_controls(i) else 0
        of_controls += width * width if g.sees_controls(i) else 0
    graph, dimensions = build_graphs(g, "f32")["transformer"], g.dimensions(window)
    assert rates.multiply_adds(graph, dimensions) == wanted
    assert rates.multiply_adds(graph, dimensions, CONTROLS) == of_controls


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
    # Only the embedding of controls, of one row, is limited by memory there.
    assert world.limit(rates.Gpu("", 10, 2000, 24), stock) == pytest.approx(world.limit(slow, stock), rel=1e-3)
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
    assert rates.table(worlds, measured.read(ROOT / "hardware")).strip() in page, f"{why} --reports hardware"
    assert rates.summary(worlds) in readme, f"{why} --summary"
    assert rates.evidence() in page, f"{why} --points"
    worst, best = (f"{100 * share:.0f} %" for share in rates.shares())
    assert f"rates {SHOWN} --reports hardware" in page and f"from {worst} to {best} of the limit" in page
    assert f"{1e6 * rates.fast_kernel_seconds():.1f} microseconds" in page
    stock, *_, slowest = rates.PRESETS_OF_THE_LIBRARY
    in_time = [[bound >= rates.REAL_TIME for gpu in rates.GPUS for bound in world.estimate(gpu, stock)] for world in worlds[1:]]
    lows, highs = ([sum(world[start::2]) for world in in_time] for start in (0, 1))
    assert f"At the high end, {highs[0]} of the {len(rates.GPUS)} GPUs run the 360P model" in page
    assert highs[1] == 0 and lows == [0, 0], "the sentence after it"
    assert f"{1e6 / (rates.REAL_TIME * worlds[0].kernels(slowest)):.1f} microseconds" in page


def test_small_weights_are_faster_only_if_they_are_not_unpacked_into_memory(worlds):
    g, stock = worlds[1].geometry, rates.PRESETS_OF_THE_LIBRARY[0]
    whole, eight, four = rates.in_each_precision("360p", g)
    starved = rates.Gpu("starved", 1000, 100, 24)
    assert whole.limit(starved, stock, unpacks=True) == whole.limit(starved, stock)
    assert four.limit(starved, stock) > eight.limit(starved, stock) > 1.5 * whole.limit(starved, stock)
    # Of 16 bits, each number is read once; of 8, half as much is read, written in 16 bits, and read again.
    unpacking = [small.limit(starved, stock, unpacks=True) for small in (eight, four)]
    assert whole.limit(starved, stock) / 2.6 < unpacking[0] < unpacking[1] < whole.limit(starved, stock) / 2
    low, high = eight.estimate(starved, stock)
    assert low < whole.estimate(starved, stock)[0] and high > whole.estimate(starved, stock)[1]
    busy = rates.Gpu("busy", 1, 10000, 24)
    assert eight.estimate(busy, stock) == pytest.approx(whole.estimate(busy, stock))


def test_the_page_shows_weights_by_bits(worlds):
    shown = rates.by_bits([rates.in_each_precision(world.name, world.geometry) for world in worlds[1:]])
    assert shown.strip() in (ROOT / "docs" / "rates.md").read_text(encoding="utf-8"), "make it again: rates ... --by-bits"


@pytest.mark.parametrize("other", [["--summary"], ["--weights", "8"], ["--reports", "hardware"]])
def test_the_table_by_bits_stands_alone(capsys, tiny, other):
    assert main(["rates", str(tiny), "--by-bits"]) == 0
    assert "coherence<br>4 bits" in capsys.readouterr().out
    assert main(["rates", str(tiny), "--by-bits", *other]) == 2
    assert other[0] in capsys.readouterr().err


def test_the_command_names_what_is_missing(capsys, tiny):
    assert main(["rates"]) == 2
    assert "--preset 360p" in capsys.readouterr().err
    assert main(["rates", str(tiny), "--summary"]) == 0
    assert "GeForce" in capsys.readouterr().out
    assert main(["rates", "--points"]) == 0
    assert "H100" in capsys.readouterr().out


def report(adapter="NVIDIA GeForce RTX 4070", memory=12, captured=10.0, anew=12.5, **changes):
    """A made-up report of a graphics adapter, with milliseconds of a latent step."""
    judged = {"name": adapter, "ids": [1, 2], "memory": memory * 2**30, "driver": "32.0.1", "software": False}
    machine = {"system": "Windows 10", "adapters": [{**judged, "name": "other"}, judged], "judged": 1, "emulated": False}
    steps = zip(measured.STEPS.values(), (captured, anew), strict=True)
    figures = [{"name": name, "value": value, "unit": "ms"} for name, value in steps]
    check = {"name": "latents", "group": "times", "verdict": "pass", "figures": figures}
    return {"schema": 1, "optimised": True, "quick": False, "machine": machine, "checks": [check]} | changes


@pytest.fixture
def folder(tmp_path):
    """Writes reports into a folder, and returns it."""

    def write(**reports):
        for name, content in reports.items():
            text = content if isinstance(content, str) else json.dumps(content)
            (tmp_path / f"{name.replace('_', '-')}.json").write_text(text, encoding="utf-8")
        return tmp_path

    return write


def test_reports_measure_what_the_estimate_is_of(worlds):
    checks = ROOT / "tools" / "check" / "src" / "checks"
    times, seed = ((checks / name).read_text(encoding="utf-8") for name in ("times.rs", "seed.rs"))
    assert "Schedule::Stock" in seed and "seed::world(&device, Precision::F16)" in times
    assert 'figures_of(&format!("{name}: a step"), &walls)' in times and '["median", "99th percentile", "longest"]' in times
    assert measured.STEPS == {how: f"{how}: a step, median" for how in re.findall(r'\("([a-z ]*passes[a-z ]*)", \d+', times)}
    assert worlds[0].name == measured.WORLD and worlds[0].geometry.global_window == rates.preset_of_reports().window
    assert "window: world.global_window()" in seed


def test_measured_rates_stand_beside_estimates_with_how_far_off_they_are(worlds, folder):
    low, high = worlds[0].estimate(next(gpu for gpu in rates.GPUS if gpu.name == "GeForce RTX 4070"), rates.preset_of_reports())
    within, slow, fast = (low + high) / 2, low / 2, 3 * high
    reports = measured.read(
        folder(
            within=report(captured=1e3 / within, anew=1e3),
            slow=report("AMD Radeon RX 7600", 8, captured=1e3, anew=1e3 / slow),
            fast=report("NVIDIA GeForce RTX 4090 | D", 24, captured=1e3 / fast),
        )
    )
    text = rates.table(worlds, reports)
    miniature, rest = text.split("### 360p", 1)
    head = next(line for line in miniature.splitlines() if "stock<br>g128" in line).split(" | ")
    assert head[2] == "stock<br>measured" and "measured" not in rest.split("### Measured")[0]
    cells = {line.split(" | ")[0].strip("| "): line.split(" | ")[2] for line in miniature.splitlines() if line.startswith("| ")}
    assert cells["GeForce RTX 4070"] == f"{within:.0f}: in the range, {within / high:.2f} of the high end"
    assert cells["Radeon RX 7600"] == f"{slow:.0f}: 2.0 times slower than the low end"
    assert cells["GeForce RTX 4090"] == "" and cells["TFLOP a latent"] == ""
    rows = [line for line in rest.split("### Measured")[1].splitlines() if "`hardware/" in line]
    assert [row.count(" | ") for row in rows] == [6, 6, 6]
    assert "captured passes" in rows[2] and f"| {within:.0f} | in the range" in rows[2] and "| 134 to 265 |" in rows[2]
    assert "passes run anew" in rows[1] and "2.0 times slower than the low end |" in rows[1]
    assert "4090 \\| D" in rows[0] and "| - | " in rows[0] and "no data sheet" in rows[0]
    assert rates.how_far_off(low, high, fast) == "3.0 times faster than the high end"


def test_gpus_are_the_same_by_name_and_memory():
    def found(adapter, memory):
        gpu = rates.gpu_of(measured.Measured("a.json", adapter, "1", memory, 1.0, "captured passes"))
        return gpu and gpu.name

    assert found("NVIDIA GeForce RTX 4070", 11.8) == "GeForce RTX 4070"
    assert found("NVIDIA GeForce RTX 4080 Laptop GPU", 12) == "GeForce RTX 4080 Laptop"
    assert found("AMD Radeon RX 9060 XT", 15.9) == "Radeon RX 9060 XT 16 GB"
    assert found("AMD Radeon(TM) 780M Graphics", 0.5) == "Radeon 780M (in a laptop's processor)"
    assert found("Intel(R) Arc(TM) B580 Graphics", 11.9) == "Arc B580"
    for other, memory in (
        ("NVIDIA GeForce RTX 4070 Laptop GPU", 8),
        ("NVIDIA GeForce RTX 4070 SUPER", 12),
        ("NVIDIA GeForce RTX 3060", 8),
        ("AMD Radeon RX 9060 XT", 8),
        ("AMD Radeon RX 7900 XT", 20),
    ):
        assert found(other, memory) is None, other


def test_reports_that_say_nothing_of_a_gpu_are_not_used(worlds, folder):
    emulated, software = report(), report()
    emulated["machine"]["emulated"] = True
    software["machine"]["adapters"][1]["software"] = True
    failed, without, nobody = report(), report(), report()
    failed["checks"][0]["verdict"] = "fail"
    without["checks"] = []
    nobody["machine"]["judged"] = None
    quick, slow = report(quick=True), report(optimised=False)
    reports = measured.read(
        folder(emulated=emulated, failed=failed, nobody=nobody, quick=quick, slow=slow, software=software, without=without)
    )
    assert not reports.measured and len(reports.unused) == 7
    text = rates.table(worlds, reports)
    assert "<br>measured" not in text and "No report of a graphics adapter has been sent yet" in text
    assert "`hardware/emulated.json`, a processor may emulate the adapter" in text and "`hardware/quick.json`, a short run" in text


def test_files_that_are_no_reports_are_named(folder, capsys):
    bundle = str(ROOT / "samples" / "worlds" / "miniature.cairn")
    for text in ("no", "[]", json.dumps({"schema": 1}), json.dumps(report(schema=2)), json.dumps(report(captured=0))):
        with pytest.raises(BuildError) as error:
            measured.read(folder(wrong=text))
        assert error.value.field.endswith("wrong.json") and "cairn-check" in error.value.remedy
    reports = str(folder(wrong="no"))
    assert main(["rates", bundle, "--reports", reports]) == 2
    assert "wrong.json" in capsys.readouterr().err
    assert main(["rates", bundle, "--reports", reports + "-not-there"]) == 2
    assert "--reports hardware" in capsys.readouterr().err
    assert main(["rates", "--preset", "tiny", "--reports", str(ROOT / "hardware")]) == 2
    assert "samples/worlds/miniature.cairn" in capsys.readouterr().err
    assert main(["rates", bundle, "--summary", "--reports", reports]) == 2
    assert "--summary" in capsys.readouterr().err

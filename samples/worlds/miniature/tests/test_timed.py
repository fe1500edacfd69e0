"""The training that is planned by time: what a GPU computes at once is what a CPU computes in blocks, and the plan holds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from miniature import adversary, autoencoder, latent_adversary, latents, levels, optimiser, rollouts, timed, train_autoencoder, train_world, transformer
from miniature.shapes import PRESETS, SMOKE, AutoencoderPlan, Stage

# These tests compile longer than they run.
jax.config.update("jax_disable_most_optimizations", True)
KEY = jax.random.key(3)
# Every kind of layer once.
SMALL = SMOKE.with_(layers=2, control_period=2, global_period=2)


def window(frames: int):
    """Parameters, noisy and clean frames, noise levels and controls of a window."""
    rng = np.random.default_rng(5)
    p = {name: jnp.asarray(value + 0.05 * rng.standard_normal(value.shape)) for name, value in transformer.initial(SMALL, 1).items()}
    x = jnp.asarray(rng.standard_normal((3, frames, SMALL.latent_height, SMALL.latent_width, SMALL.latent_channels)), jnp.float32)
    sigma = jnp.asarray(rng.uniform(0, 1, (3, frames)), jnp.float32)
    controls = jnp.asarray(rng.standard_normal((frames, 2 + SMALL.buttons + 1)), jnp.float32)
    return {name: value.astype(jnp.float32) for name, value in p.items()}, x, sigma, controls


def test_all_blocks_at_once_give_the_same_velocities_and_gradients():
    for frames in (16, 48):
        p, x, sigma, controls = window(frames)
        mean = lambda p, wide: jnp.mean(jnp.square(transformer.velocity(p, SMALL, x, sigma, controls, 128, wide)))
        (narrow, wide) = (jax.jit(jax.value_and_grad(mean), static_argnums=1)(p, wide) for wide in (False, True))
        assert abs(narrow[0] - wide[0]) < 1e-5 * narrow[0] and narrow[0] > 0.01
        for name, gradient in narrow[1].items():
            np.testing.assert_allclose(wide[1][name], gradient, atol=2e-5 * float(jnp.abs(gradient).max()) + 1e-7, err_msg=name)


def test_half_precision_stays_near():
    p, x, sigma, controls = window(16)
    velocity = jax.jit(lambda p, x, wide: train_world._velocity(p, SMALL, x, sigma, controls, 128, wide), static_argnums=2)
    exact, near = (velocity(p, x, wide) for wide in (False, True))
    assert near.dtype == jnp.float32
    assert 1e-5 < jnp.sqrt(jnp.mean(jnp.square(exact - near)) / jnp.mean(jnp.square(exact))) < 0.03


def test_matrices_of_a_shape_become_orthogonal_together():
    rng = np.random.default_rng(1)
    shapes = {"a": (8, 16), "b": (16, 8), "c": (8, 16)}
    matrices = {name: jnp.asarray(rng.standard_normal(shape), jnp.float32) for name, shape in shapes.items()}
    together = optimiser.orthogonal_by_shape(matrices)
    assert set(together) == set(matrices)
    for name, x in matrices.items():
        np.testing.assert_allclose(together[name], optimiser.orthogonal(x), atol=1e-4)


def test_the_rate_follows_the_clock_where_a_step_is_given():
    settings = optimiser.Settings(rate=0.1, steps=100, warm_up=10, cool_down=0.5, clip=1e9)
    state = optimiser.start({"a": np.ones((2, 2), np.float32)})
    moved = []
    for at in (0, 30, 75, 100):
        after, _ = optimiser.update(settings, state, {"a": jnp.ones((2, 2))}, jnp.int32(at))
        moved.append(float(jnp.abs(after.parameters["a"] - 1).max()))
    np.testing.assert_allclose(moved, [0.01, 0.1, 0.05, 0.0], atol=1e-4)


def test_short_walks_come_first_and_every_stage_has_its_share():
    plan = PRESETS["levels"].timed
    lengths = [plan.seconds_of(number) for number in range(300)]
    assert set(lengths[: plan.short.count]) == {plan.short.seconds} and set(lengths[plan.short.count :]) == set(plan.cycle)
    assert abs(sum(share for share, _ in plan.stages) - 1) < 1e-9
    assert max(plan.cycle) * 15 + 1 >= max(stage.frames for _, stage in plan.stages)
    # Each length comes in every family.
    assert {(number % 4, length) for number, length in enumerate(lengths)} >= {(family, length) for family in range(4) for length in plan.cycle}
    stages = [next(timed.Training._stages(type("T", (), {"plan": plan}), share)) for share in (0, 0.2, 0.5, 0.9)]
    assert stages == [0, 1, 2, 3]


def test_the_plan_of_pictures_as_shown_fits_its_walks():
    preset = PRESETS["levels-longer"]
    plan, width, height = preset.timed, *preset.timed.shown
    assert abs(sum(share for share, _ in plan.stages) - 1) < 1e-9 and plan.judged
    assert max(plan.cycle) * 15 + 1 >= max(stage.frames for _, stage in plan.stages)
    # Walks that were encoded before are other ones than those drawn during the training.
    assert preset.first + preset.world.count <= plan.first_number
    assert plan.autoencoder.crop == (width, height) and width * 9 == height * 16 and plan.autoencoder.decoded == preset.geometry.decoded


def test_latents_of_held_out_walks_are_refused(tmp_path):
    held_out, training = levels.held_out_walk("snow", 1), levels.training_walk(3, 2.2)
    (tmp_path / "snow-1001-3.npz").touch()
    (tmp_path / "snow-1001-3.txt").write_text(training.script)
    levels.require_trainable_latents([tmp_path / "snow-1001-3.npz"])
    (tmp_path / "snow-1001-3.txt").write_text(held_out.script)
    with pytest.raises(levels.HeldOutWalk, match="is held out"):
        levels.require_trainable_latents([tmp_path / "snow-1001-3.npz"])
    (tmp_path / "snow-1001-3.txt").unlink()
    with pytest.raises(levels.HeldOutWalk, match="no script"):
        levels.require_trainable_latents([tmp_path / "snow-1001-3.npz"])


def test_a_walk_that_is_not_mirrored_has_one_side():
    rng = np.random.default_rng(1)
    walk = {
        "moving": rng.standard_normal((1, 24, 2, 4, 8)).astype(np.float16),
        "still": rng.standard_normal((1, 7, 2, 4, 8)).astype(np.float16),
        "controls": rng.standard_normal((1, 24, 259)).astype(np.float16),
    }
    walks = latents.Walks({"snow-1001-3": walk})
    stage = Stage(steps=0, frames=16, batch=2, noisy=1)
    found, others, controls = train_world.batch(rng, walks, stage)
    assert found.shape == others.shape == (2, 16, 2, 4, 8) and controls.shape == (2, 16, 259)
    start = next(n for n in range(7) if (walk["still"][0, n] == found[0, 0]).all())
    np.testing.assert_array_equal(found[0, 1:], walk["moving"][0, 4 * start : 4 * start + 15])
    assert not controls[:, 0].any()


def test_a_killed_training_keeps_its_times(tmp_path):
    first = timed.Clock(tmp_path, 100.0)
    (tmp_path / "end").write_text(str(first.began + 50))
    again = timed.Clock(tmp_path, 100.0)
    assert again.began == first.began and again.end == first.began + 50
    (tmp_path / "end").write_text("")
    assert again.end == first.began + 100


def test_rollouts_are_scored_against_the_truth_and_the_first_picture():
    rng = np.random.default_rng(2)
    true = rng.integers(0, 200, (31, 12, 16, 3)).astype(np.uint8)
    near = lambda picture: (picture.astype(int) + 4).astype(np.uint8)
    found = rollouts.score(true, near, lambda q: near(true[q]))
    assert set(found.psnr) == {1.0, 2.0} and len(found.shown) == 3
    world, repeated, reconstruction = found.psnr[2.0]
    assert abs(world - 20 * np.log10(255 / 4)) < 0.01 and repeated < 15 and reconstruction < 15
    assert abs(found.detail[1.0] - 1) < 1e-6 and 1.02 < found.brightness[2.0] < 1.06
    flat = rollouts.score(true, near, lambda q: np.full_like(true[q], true[q].mean()))
    assert flat.detail[2.0] == 0 and abs(flat.brightness[1.0] - 1) < 0.02
    assert rollouts.lines("forest", [found, flat])[1].startswith("forest      2 s  PSNR ")


def test_a_fixed_encoder_learns_nothing_and_the_decoder_does():
    g = SMOKE.with_(latent_height=4)
    plan = AutoencoderPlan(clips=1, steps=4, batch=1, latents=2, crop=(64, 64), rate=1e-3, fixed_encoder=True)
    state = train_autoencoder.start(autoencoder.initial(g, 1), plan)
    before = {name: np.asarray(value) for name, value in state.parameters.items()}
    pictures = np.random.default_rng(1).integers(0, 255, (1, 2, 4, 64, 64, 3)).astype(np.uint8)
    settings = optimiser.Settings(rate=plan.rate, steps=4, warm_up=1)
    state, _ = train_autoencoder.step(settings, plan, None, state, pictures, KEY, jnp.int32(2))
    changed = {name for name, value in state.parameters.items() if (np.asarray(value) != before[name]).any()}
    assert changed and all(name.startswith("decoder.") for name in changed)


def test_mixed_copies_have_a_loss_of_their_own():
    p, x, _, controls = window(16)
    losses = []
    for mixed in (0, 1):
        stage = Stage(steps=0, frames=16, batch=1, noisy=2, few_step=True, mixed=mixed)
        loss = jax.jit(lambda p, g, x, stage=stage: train_world.loss(p, SMALL, stage, g, x[0], x[1], controls, KEY)[0])
        losses.append(float(loss(p, jnp.int32(128), x)))
    assert np.isfinite(losses).all() and losses[0] != losses[1]


def test_pictures_are_resized_as_by_the_library():
    rng = np.random.default_rng(4)
    picture = rng.uniform(0, 1, (2, 9, 12, 3)).astype(np.float32)

    def along(values: np.ndarray, axis: int, size: int) -> np.ndarray:
        length = values.shape[axis]
        at = np.clip((np.arange(size) + 0.5) * length / size - 0.5, 0, length - 1)
        low = np.minimum(at.astype(int), length - 2)
        share = (at - low).reshape([-1 if n == axis else 1 for n in range(values.ndim)])
        return np.take(values, low, axis) * (1 - share) + np.take(values, low + 1, axis) * share

    for height, width in ((18, 20), (5, 7), (9, 12)):
        np.testing.assert_allclose(train_autoencoder.resized(jnp.asarray(picture), height, width), along(along(picture, 1, height), 2, width), atol=1e-6)


def test_a_decoder_learns_for_pictures_of_another_size():
    plan = AutoencoderPlan(clips=1, steps=4, batch=1, latents=2, crop=(80, 45), decoded=SMOKE.decoded, rate=1e-3, fixed_encoder=True)
    state = train_autoencoder.start(autoencoder.initial(SMOKE, 1), plan)
    before = {name: np.asarray(value) for name, value in state.parameters.items()}
    pictures = np.random.default_rng(1).integers(0, 255, (1, 2, 4, 45, 80, 3)).astype(np.uint8)
    state, figures = train_autoencoder.step(optimiser.Settings(rate=plan.rate, steps=4, warm_up=1), plan, None, state, pictures, KEY, jnp.int32(2))
    changed = {name for name, value in state.parameters.items() if (np.asarray(value) != before[name]).any()}
    assert changed and all(name.startswith("decoder.") for name in changed) and np.isfinite(float(figures["loss"]))


def judged(pull: float | None, few_step: bool):
    """Gradient and figures of a window with a discriminator."""
    p, x, _, controls = window(16)
    p |= {name: jnp.asarray(value) for name, value in latent_adversary.initial(SMALL.latent_channels, 1).items()}
    stage = Stage(steps=0, frames=16, batch=1, noisy=2, few_step=few_step, mixed=int(few_step), adversary=pull)
    loss = lambda p, g: train_world.loss(p, SMALL, stage, g, x[0], x[1], controls, KEY)
    (_, figures), gradient = jax.jit(jax.value_and_grad(loss, has_aux=True))(p, jnp.int32(128))
    norm = lambda of: float(jnp.sqrt(sum(jnp.sum(jnp.square(g)) for name, g in gradient.items() if name.startswith(adversary.PREFIX) == of)))
    return {name: g for name, g in gradient.items() if not name.startswith(adversary.PREFIX)}, norm(False), norm(True), figures


@pytest.mark.long
def test_the_discriminator_of_latents_learns_alone_and_then_pulls():
    for few_step in (False, True):
        (without, norm, none, _), (alone, _, learns, figures), (pulled, _, again, _) = (judged(pull, few_step) for pull in (None, 0.0, 0.5))
        assert none == 0 and 0 < learns < 0.1 * norm and again == pytest.approx(learns, rel=1e-4)
        assert 0.5 < float(figures["adversary"]) < 8 and float(figures["detail"]) > 0
        for name, gradient in without.items():
            np.testing.assert_allclose(alone[name], gradient, atol=1e-6 * norm, err_msg=name)
        moved = np.sqrt(sum(float(jnp.sum(jnp.square(pulled[name] - gradient))) for name, gradient in without.items()))
        assert 0.02 * norm < moved < 2 * norm


def test_the_discriminator_of_latents_tells_a_blur():
    rng = np.random.default_rng(1)
    before, sharp = (jnp.asarray(rng.standard_normal((8, 4, 8, 8)), jnp.float32) for _ in range(2))
    blurred = (sharp + jnp.roll(sharp, 1, 2)) / 2
    state = optimiser.start(latent_adversary.initial(8, 1))
    settings = optimiser.Settings(rate=2e-3, steps=60, warm_up=1, cool_down=0.01)
    loss = lambda p: latent_adversary.discriminator_loss(p, before, sharp, blurred, jnp.float32)
    step = jax.jit(lambda state: optimiser.update(settings, state, jax.grad(loss)(state.parameters))[0])
    first = loss(state.parameters)
    for _ in range(40):
        state = step(state)
    assert loss(state.parameters) < 0.5 * first
    assert float(train_autoencoder.detail(blurred)) < 0.9 * float(train_autoencoder.detail(sharp))

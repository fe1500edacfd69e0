"""Training: what it must never see, that it learns, and that an interruption leaves no trace."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from miniature import __main__, autoencoder, clips, held_out, latent_adversary, latents, optimiser, pieces, schedules, scripts, store
from miniature import train_autoencoder, train_world, transformer
from miniature.shapes import PRESETS, SMOKE, AutoencoderPlan, Stage, Walks, WorldPlan

# These tests compile longer than they run.
jax.config.update("jax_disable_most_optimizations", True)
KEY = jax.random.key(1)
PLAN = AutoencoderPlan(clips=2, steps=6, batch=1, latents=2, crop=(32, 32), rate=2e-3)


@pytest.fixture
def drawn(tmp_path):
    """Two short clips of moving colours, as the renderer would leave them."""
    width, height = SMOKE.decoded
    for number in range(2):
        family, seed = clips.clip_name(number)
        t, y, x = np.mgrid[0:33, 0:height, 0:width]
        pictures = np.stack([(x * 4 + t * 5) % 256, y * 6 + number * 30, (x + y + t) * 2 % 256], -1).astype(np.uint8)
        pictures.tofile(tmp_path / f"{family}-{seed}.rgb")
        (tmp_path / f"{family}-{seed}.controls").write_text("3.5 -1 0 65 87\n" * 8)
    return clips.ready(tmp_path, SMOKE.decoded)


@pytest.fixture
def walks(drawn, tmp_path):
    """The latents of those clips by an untrained autoencoder."""
    encoder = latents.Encoder(autoencoder.initial(SMOKE, 1))
    for clip in drawn:
        latents.encode_clip(encoder, clip, tmp_path / "latents" / f"{clip.path.name}.npz")
    return latents.Walks.read(tmp_path / "latents")


def test_every_preset_can_be_named():
    assert set(__main__.PRESET_NAMES) == set(PRESETS)


def test_held_out_seeds_are_refused():
    assert {1, 4, 5, 6, 7, 41} <= held_out.held_out_seeds()
    for seed in (0, 7, 999):
        with pytest.raises(held_out.HeldOutSeed, match=str(seed)):
            held_out.require_trainable(seed)
    for preset in PRESETS.values():
        used = {clips.clip_name(n)[1] for n in range(preset.clips.start, preset.clips.stop + preset.world.count)}
        assert not used & held_out.held_out_seeds()


def test_what_goes_on_from_a_world_asks_for_one(tmp_path):
    for command in ("walks", "world", "all"):
        with pytest.raises(SystemExit, match="Run `begin` first"):
            __main__.main(["--folder", str(tmp_path / "new"), "--preset", "further", command])


def test_an_empty_list_of_held_out_seeds_is_an_error(tmp_path):
    (tmp_path / "list.txt").write_text("# nothing\n")
    with pytest.raises(ValueError, match="no seed"):
        held_out.held_out_seeds(tmp_path / "list.txt")


def test_scripts_are_of_one_seed_one_script_and_turn_back():
    draw = [scripts.random_script(np.random.default_rng(s), 36.0) for s in (1, 1, 2)]
    assert draw[0] == draw[1] != draw[2]
    turned = 0
    for seed in range(40):
        motions = [line.split()[2] for line in scripts.random_script(np.random.default_rng(seed), 36.0).splitlines() if " mouse " in line]
        turned += sum(float(a) == -float(b) and abs(float(a)) > 300 for a, b in zip(motions, motions[1:]))
    assert turned > 20


def test_controls_are_read_as_the_model_takes_them():
    controls = clips.read_controls("3.5 -1 0 65 87\n0 0 -1\n")
    assert controls.shape == (2, 259)
    assert controls[0, :2].tolist() == [3.5, -1] and np.flatnonzero(controls[0, 2:-1]).tolist() == [65, 87]
    assert controls[1, -1] == -1 and np.count_nonzero(controls[1]) == 1
    other = latents.mirrored(controls)
    assert other[0, :2].tolist() == [-3.5, -1] and np.flatnonzero(other[0, 2:-1]).tolist() == [68, 87]


def test_a_window_starts_with_a_still_and_pairs_controls_with_what_they_caused(walks):
    latents_, controls = walks.window(np.random.default_rng(3), 5)
    assert not controls[0].any() and controls[1:].any(1).all()
    walk = next(w for w in walks.walks for side in (0, 1) for s in w["still"][side] if np.array_equal(s, latents_[0]))
    side, at = next((i, j) for i in (0, 1) for j, s in enumerate(walk["still"][i]) if np.array_equal(s, latents_[0]))
    assert np.array_equal(latents_[1:], walk["moving"][side, at : at + 4])


def test_windows_of_one_kind_of_place_are_taken_as_often_as_told(walks):
    def share(*more):
        rng = np.random.default_rng(5)
        taken = [walks.window(rng, 5, *more)[0][0].tobytes() for _ in range(400)]
        sword = {s.tobytes() for name, w in zip(walks.names, walks.walks) if name.startswith("sword") for side in w["still"] for s in side}
        return sum(still in sword for still in taken) / len(taken)

    even = share()
    assert 0 < even < 1
    # Odds, not shares, grow by as much.
    assert share("sword", 3.0) == pytest.approx(3 * even / (3 * even + 1 - even), abs=0.06)
    assert share("sword", 0.0) == 0 and share("desert", 3.0) == even


def test_interrupted_training_of_the_autoencoder_ends_in_the_same_bits(drawn, tmp_path):
    whole = train_autoencoder.train(tmp_path / "whole.npz", SMOKE, PLAN, drawn, minutes=60, say=lambda _: None)
    for _ in range(PLAN.steps):
        # No time at all: one step, and the state is kept.
        parts = train_autoencoder.train(tmp_path / "parts.npz", SMOKE, PLAN, drawn, minutes=0, say=lambda _: None)
    assert int(parts.step) == int(whole.step) == PLAN.steps
    assert all(np.array_equal(whole.parameters[name], parts.parameters[name]) for name in whole.parameters)
    _, facts = store.load(tmp_path / "parts.npz")
    assert facts["flops"] == PLAN.steps * train_autoencoder.flops(SMOKE, PLAN) and facts["seconds"] > 0


def test_the_autoencoder_learns(drawn, tmp_path):
    shown = []
    plan = AutoencoderPlan(clips=2, steps=120, batch=2, latents=2, crop=(64, 32), rate=3e-3)
    train_autoencoder.train(tmp_path / "state.npz", SMOKE, plan, drawn, minutes=60, say=shown.append)
    psnr = [float(line.partition("psnr ")[2].split()[0]) for line in shown]
    assert psnr[-1] > psnr[0] + 1, shown


@pytest.mark.long
def test_the_transformer_learns_and_goes_through_its_curriculum(walks, tmp_path):
    stages = (Stage(60, frames=8, batch=2, noisy=2), Stage(2, frames=8, batch=1, noisy=1), Stage(2, frames=8, batch=1, noisy=1, few_step=True))
    plan = WorldPlan((Walks(2, 0.5),), rate=3e-3, decay=0.0, stages=stages)
    shown = []
    state = train_world.train(tmp_path / "world.npz", SMOKE, plan, walks, minutes=60, say=shown.append)
    assert int(state.step) == 64
    loss = [float(line.partition("loss ")[2].split()[0]) for line in shown]
    assert loss[2] < 0.9 * loss[0], shown


def test_a_training_ends_where_it_is_told_to_and_goes_on(walks, tmp_path):
    plan = WorldPlan((Walks(2, 0.5),), rate=3e-3, decay=0.0, stages=(Stage(4, frames=8, batch=1, noisy=1),))
    whole, parts = (
        [
            int(train_world.train(tmp_path / name, SMOKE, plan, walks, minutes=60, say=lambda _: None, until=until).step)
            for until in ends
        ]
        for name, ends in (("whole.npz", [9]), ("parts.npz", [3, 2, 4]))
    )
    # The learning rate falls as the plan has it, wherever it is left.
    assert (whole, parts) == ([4], [3, 3, 4])
    ended = [store.mean_parameters(tmp_path / name) for name in ("whole.npz", "parts.npz")]
    assert all(np.array_equal(ended[0][name], value) for name, value in ended[1].items())


def test_later_walks_are_drawn_from_their_stage_on(walks):
    stages = (Stage(3, frames=8, batch=1, noisy=1), Stage(2, frames=8, batch=1, noisy=1), Stage(2, frames=8, batch=1, noisy=1))
    plan = WorldPlan((Walks(1, 0.5), Walks(1, 0.6, from_stage=1)), rate=3e-3, decay=0.0, stages=stages)
    assert [plan.seconds_of(walk) for walk in range(plan.count)] == [0.5, 0.6]
    assert [plan.count_at(step) for step in range(plan.steps)] == [1, 1, 1, 2, 2, 2, 2]
    alone = walks.among({"forest-1000"})
    assert walks.names == ("forest-1000", "sword-1000") and alone.names == ("forest-1000",)
    frames, _ = alone.window(np.random.default_rng(3), 5)
    assert any(np.array_equal(frames[0], still) for side in walks.walks[0]["still"] for still in side)


def test_schedules_are_refined_where_they_are_widest():
    stock = (1.0, 0.9, 0.75, 0.3, 0.0)
    assert schedules.refined(stock, 4) == stock
    assert schedules.refined(stock, 9) == (1, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.15, 0)
    assert schedules.refined(stock, 10) == (1, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0)
    assert schedules.refined(stock, 12) == (1, 0.9, 0.825, 0.75, 0.69375, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0.075, 0)
    assert schedules.passes(stock) == [(1, 1), (1, 0.9), (0.9, 0.75), (0.75, 0.3)]


def test_few_steps_are_trained_where_the_networks_own_step_leads(walks):
    g = SMOKE.with_(layers=2, control_period=2, global_period=2)
    copies, frames = 40, 4
    latents_, _, controls = (x[0] for x in train_world.batch(np.random.default_rng(1), walks, Stage(1, frames=frames, batch=1, noisy=1)))
    clean = jnp.asarray(latents_, jnp.float32)
    noise = jax.random.normal(jax.random.key(3), (copies, *clean.shape))
    still = transformer.initial(g, 1)
    moving = still | {"unpatchify.bias": np.full(g.latent_channels, 2.0, np.float32)}
    ways = [train_world.sampler_step(p, g, 128, clean, clean, noise, jnp.asarray(controls, jnp.float32), KEY) for p in (still, moving)]
    # A network that goes nowhere stays at the level before; one whose velocity is 2 goes two differences of level.
    (at, sigma, made, told), (further, same, *_) = ways
    before = jnp.median((at - clean) / (noise - clean), (2, 3, 4))
    assert np.allclose(told, before, atol=1e-4)
    pairs = {(round(float(a), 4), round(float(b), 4)) for a, b in zip(before.ravel(), sigma.ravel())}
    stock = g.schedule
    assert pairs == set(schedules.passes(stock)) | set(schedules.passes(schedules.refined(stock, train_world.REFINED)))
    assert np.array_equal(sigma, same) and np.allclose(made, at, atol=1e-6)
    assert np.allclose(further - at, 2 * (sigma - before)[..., None, None, None], atol=1e-4)


def test_drift_lasts_and_is_of_unit_size():
    found = np.asarray(jax.vmap(lambda key: train_world.drift(key, (40, 8, 16, 4)))(jax.random.split(KEY, 60)))
    assert abs(found.var() - 1) < 0.25 and abs(found.mean()) < 0.05
    together = lambda a, b: (a * b).mean() / found.var()  # noqa: E731
    apart = [together(found[:, 0:-n], found[:, n:]) for n in (1, 30)]
    assert 0.45 < apart[0] < 0.65 and apart[1] < 0.3, apart
    # The mean of a channel is off by more than a mean of independent numbers would be.
    assert found.mean((2, 3)).std() > 0.4


def test_parts_of_the_past_are_another_walks_for_a_while():
    found = np.asarray(jax.vmap(lambda key: train_world.contamination(key, (40, 8, 16, 4)))(jax.random.split(KEY, 200)))
    assert found.shape == (200, 40, 8, 16, 1) and found.min() >= 0 and found.max() < 1
    none = (found.max((1, 2, 3, 4)) == 0).mean()
    assert abs(none - (1 - train_world.CONTAMINATED)) < 0.12, none
    spoilt = found[found.max((1, 2, 3, 4)) > 0]
    assert 0.02 < spoilt.mean() < 0.2 and spoilt.max() > 0.8, spoilt.mean()
    # Neighbours in time are spoilt together.
    together = lambda n: np.corrcoef(spoilt[:, :-n].ravel(), spoilt[:, n:].ravel())[0, 1]  # noqa: E731
    assert together(1) > 0.8 and together(30) < 0.7 * together(1), (together(1), together(30))


def test_gradients_are_those_of_differences(walks):
    """Derivatives that the transformer states itself, against differences of the loss."""
    g = SMOKE.with_(layers=2, control_period=2, global_period=2)
    rng = np.random.default_rng(2)
    start = transformer.initial(g, 1)
    p = {name: jnp.asarray(v + 0.05 * rng.standard_normal(v.shape), jnp.float32) for name, v in start.items()}
    latents_, others, controls = train_world.batch(rng, walks, Stage(1, frames=4, batch=1, noisy=1))
    of = jax.jit(lambda p: train_world.loss(p, g, Stage(1, 4, 1, 1), 128, latents_[0], others[0], controls[0], KEY)[0])
    gradient = jax.jit(jax.grad(of))(p)
    for name in ("attn.q_proj", "attn.k_proj", "attn.v_proj", "attn.out_proj", "mlp.fc1", "mlp.fc2"):
        name = f"blocks.1.{name}.weight"
        along = gradient[name] / jnp.linalg.norm(gradient[name])
        far = 0.02
        slope = (of(p | {name: p[name] + far * along}) - of(p | {name: p[name] - far * along})) / (2 * far)
        assert np.isclose(slope, jnp.linalg.norm(gradient[name]), rtol=0.02), name


def test_channels_means_count_in_frames_of_noise_alone(walks):
    g = SMOKE.with_(layers=2, control_period=2, global_period=2)
    latents_, others, controls = (x[0] for x in train_world.batch(np.random.default_rng(3), walks, Stage(1, frames=8, batch=1, noisy=1)))

    def loss(**how):
        of = jax.jit(lambda p: train_world.loss(p, g, Stage(1, 8, 1, 4, **how), 128, latents_, others, controls, KEY))
        return of(transformer.initial(g, 1))

    (plain, figures), (heavy, same) = (loss(few_step=True, means=means) for means in (0.0, 16.0))
    assert figures["means"] > 0 and np.isclose(heavy - plain, 16 * same["means"], rtol=1e-3)
    assert loss(means=16.0)[1]["means"] == 0, "at levels below 1 a frame tells its own means"


@pytest.mark.long
def test_windows_side_by_side_are_windows_one_by_one(walks):
    g = SMOKE.with_(layers=2, control_period=2, global_period=2)
    settings = optimiser.Settings(rate=0.0, steps=10, muon_rate=0.0)
    batch = train_world.batch(np.random.default_rng(1), walks, Stage(1, frames=4, batch=4, noisy=2))
    figures = []
    for together in (1, 2, 4):
        stage = Stage(1, frames=4, batch=4, noisy=2, together=together, few_step=True, means=16.0, adversary=0.5)
        state = optimiser.start(transformer.initial(g, 1) | latent_adversary.initial(g.latent_channels, 1))
        figures.append(train_world.step(settings, g, stage, 128, state, *batch, KEY)[1])
    for name, value in figures[0].items():
        assert np.allclose([f[name] for f in figures], value, rtol=1e-4) and value > 0, name


def test_muon_moves_a_matrix_by_about_an_orthogonal_one():
    rng = np.random.default_rng(1)
    for shape in ((24, 8), (8, 24), (16, 16)):
        values = np.linalg.svd(optimiser.orthogonal(jnp.asarray(rng.standard_normal(shape), jnp.float32)), compute_uv=False)
        assert 0.5 < values.min() and values.max() < 1.3, values
    settings = optimiser.Settings(rate=0.1, steps=10, warm_up=1, muon_rate=0.5, muon_momentum=0.0)
    state = optimiser.start({"a": np.zeros((8, 4), np.float32), "b": np.zeros(4, np.float32)}, lambda name: name == "a")
    after, _ = optimiser.update(settings, state, {"a": 1e-3 * jnp.ones((8, 4)), "b": jnp.ones(4)})
    assert after.second["a"].size == 0 and after.second["b"].size == 4
    # A matrix of rank one: its orthogonal part has length one, which the scale of 0.2 sqrt(8) and the rate multiply.
    assert np.isclose(np.linalg.norm(after.parameters["a"]), 0.5 * 0.2 * 8**0.5, rtol=0.35)
    assert np.allclose(after.parameters["b"], -0.1, rtol=1e-3)


def test_a_state_travels_in_pieces(tmp_path):
    content = np.random.default_rng(1).bytes(2500)
    (tmp_path / "state.npz").write_bytes(content)
    written = pieces.split(tmp_path / "state.npz", tmp_path / "pieces", longest=1000)
    assert [piece.stat().st_size for piece in written] == [1000, 1000, 500]
    (tmp_path / "state.npz").unlink()
    pieces.join(tmp_path / "pieces", tmp_path / "state.npz")
    assert (tmp_path / "state.npz").read_bytes() == content
    (tmp_path / "state.npz").unlink()
    written[1].write_bytes(bytes(1000))
    with pytest.raises(pieces.BrokenPieces, match="another file"):
        pieces.join(tmp_path / "pieces", tmp_path / "state.npz")
    written[1].unlink()
    with pytest.raises(pieces.BrokenPieces, match="state.npz.001"):
        pieces.join(tmp_path / "pieces", tmp_path / "state.npz")
    assert not (tmp_path / "state.npz").exists()
    # A shorter file leaves no piece of the longer one.
    (tmp_path / "state.npz").write_bytes(content[:900])
    pieces.split(tmp_path / "state.npz", tmp_path / "pieces", longest=1000)
    assert sorted(p.name for p in (tmp_path / "pieces").iterdir()) == ["state.npz.000", "state.npz.pieces"]


def test_a_gradient_that_is_not_finite_moves_nothing():
    settings = optimiser.Settings(rate=0.1, steps=10, warm_up=1)
    state = optimiser.start({"a": np.ones(3, np.float32)})
    after, norm = optimiser.update(settings, state, {"a": jnp.array([1.0, jnp.nan, 0.0])})
    assert not np.isfinite(norm) and np.array_equal(after.parameters["a"], state.parameters["a"])
    after, _ = optimiser.update(settings, state, {"a": jnp.ones(3)})
    assert not np.array_equal(after.parameters["a"], state.parameters["a"])

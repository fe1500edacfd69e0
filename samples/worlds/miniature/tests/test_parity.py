"""The networks that are trained are those that run: JAX against ONNX Runtime, on a bundle that `cairn.build` makes of a checkpoint."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cairn.build.checkpoint import open_checkpoint
from cairn.build.manifest import Licence
from cairn.build.writer import build_bundle
from conftest import relative, session
from miniature import autoencoder, export, transformer
from miniature.shapes import SMOKE
from rollout import Rollout

# These tests compile longer than they run.
jax.config.update("jax_disable_most_optimizations", True)
# Long enough that both rings wrap.
G = SMOKE.with_(local_window=4, global_window=16, global_dilation=4, global_max_window=32)
FRAMES = 28
# float32 sums in another order; a wrong name, order or mask is off by a tenth at least.
BOUND = 2e-4


def random_parameters(initial: dict, seed: int) -> dict[str, np.ndarray]:
    """Numbers that float16 holds exactly, with no zeros that would hide a path."""
    rng = np.random.default_rng(seed)
    out = {}
    for name, value in initial.items():
        scale = 0.3 if value.ndim < 2 else 0.8 / np.sqrt(value[0].size if value.ndim == 4 else value.shape[0])
        out[name] = (rng.standard_normal(value.shape) * scale).astype(np.float16).astype(np.float32)
    return out


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Parameters of both networks, and the bundle that is made of them by the path of real weights."""
    folder = tmp_path_factory.mktemp("miniature")
    p, a = random_parameters(transformer.initial(G, 1), 2), random_parameters(autoencoder.initial(G, 1), 3)
    export.write_checkpoint(folder / "checkpoint", G, p, a)
    found = open_checkpoint(folder / "checkpoint", max_window=G.global_max_window)
    assert found.geometry == G and found.too_small == 0
    bundle = build_bundle(
        G, found, folder / "bundle", name="m", provenance=found.provenance, licence=Licence("CC0-1.0"), rounding="none"
    )
    return p, a, bundle


def velocity(p, x, sigma, controls, window):
    """All velocities of a window, compiled as one."""
    return jax.jit(lambda *a: transformer.velocity(*a[:1], G, *a[1:], window))(p, x, sigma, controls)


@pytest.mark.parametrize(("window", "frames"), [(16, FRAMES), (32, FRAMES), (16, 4), (16, 3)])
def test_velocity_of_every_frame_over_its_past(world, window, frames):
    """Windows of many blocks, of one, and of less."""
    p, _, bundle = world
    rng = np.random.default_rng(4)
    shape = (frames, G.latent_height, G.latent_width, G.latent_channels)
    kept, noisy = rng.standard_normal((2, *shape)).astype(np.float32)
    controls = rng.standard_normal((frames, G.control_width)).astype(np.float32)
    sigma = np.stack([np.zeros(frames), rng.uniform(0, 1, frames)]).astype(np.float32)
    v = velocity(p, jnp.stack([kept, noisy]), sigma, controls, window)

    rollout = Rollout(bundle, G, "f32", window)
    for q in range(frames):
        for copy in (1, 0):
            x = (kept, noisy)[copy][q].transpose(2, 0, 1)[None]
            outputs = rollout.run(x, sigma[copy, q], -1.0, controls[q : q + 1])
            expected = (x - outputs[0])[0].transpose(1, 2, 0)
            assert relative(np.asarray(v[copy, q]), expected) < BOUND, (q, copy)
        rollout.commit(outputs)


def test_the_past_carries_weight_in_this_comparison(world):
    p, _, _ = world
    rng = np.random.default_rng(5)
    x = rng.standard_normal((2, 8, G.latent_height, G.latent_width, G.latent_channels)).astype(np.float32)
    sigma, controls = np.full((2, 8), 0.5, np.float32), np.zeros((8, G.control_width), np.float32)
    # JAX may still read the first one when the call has come back.
    moved = x.copy()
    moved[0, :-1] += 1
    v, other = velocity(p, x, sigma, controls, 16), velocity(p, moved, sigma, controls, 16)
    assert relative(np.asarray(other[1, -1]), np.asarray(v[1, -1])) > 100 * BOUND


def test_latents_of_clips(world):
    _, a, bundle = world
    width, height = G.decoded
    rgb = np.random.default_rng(6).uniform(0, 1, (3, 4, height, width, 3)).astype(np.float32)
    encoder = session(bundle, "encoder", "f32")
    for clip, latent in zip(rgb, np.asarray(jax.jit(autoencoder.encode)(a, rgb))):
        (expected,) = encoder.run(None, {"rgb": clip.transpose(0, 3, 1, 2)})
        assert relative(latent.transpose(2, 0, 1)[None], expected) < BOUND


def test_pictures_of_a_sequence_of_latents(world):
    _, a, bundle = world
    latents = np.random.default_rng(7).standard_normal((1, 3, G.latent_height, G.latent_width, G.latent_channels)).astype(np.float32)
    pictures = np.clip(np.asarray(jax.jit(autoencoder.decode)(a, latents)), 0, 1)[0].reshape(3, 4, *G.decoded[::-1], 3)
    decoder = session(bundle, "decoder", "f32")
    memories = [np.zeros((1, *shape), np.float32) for shape in G.memories]
    for latent, made in zip(latents[0], pictures):
        feeds = {"latent": latent.transpose(2, 0, 1)[None], **{f"past_mem.{j}": m for j, m in enumerate(memories)}}
        expected, *memories = decoder.run(None, feeds)
        assert 0.05 < expected.std(), "the pictures are clipped flat"
        assert relative(made.transpose(0, 3, 1, 2), expected) < BOUND

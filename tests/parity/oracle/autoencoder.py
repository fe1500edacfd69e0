"""The autoencoder (TAEHV) over a whole clip at once: time is the first axis, nothing is streamed.

A *memory block* reads its input and its input at the time step before (zeros before the first). The runtime's decoder gets one latent
at a time and carries nine such inputs from one latent to the next. Here the whole sequence is one array, and the input of the step
before is a shift by one along time; both agree only if the streaming is right. Priming prepends three more copies of the first latent.
"""

import numpy as np

from .weights import Convolution, DecoderWeights, EncoderWeights, MemoryBlock

PRIMING = 3


def convolve(x: np.ndarray, conv: Convolution, stride: int = 1) -> np.ndarray:
    """Convolves `[N, in, H, W]` with a square kernel of odd side, zero-padded by half its side."""
    n, channels, H, W = x.shape
    out, inner, side, _ = conv.weight.shape
    assert inner == channels
    edge = side // 2
    x = np.pad(x, ((0, 0), (0, 0), (edge, edge), (edge, edge)))
    windows = np.lib.stride_tricks.sliding_window_view(x, (side, side), axis=(2, 3))[:, :, ::stride, ::stride]
    rows, columns = windows.shape[2:4]
    flat = windows.transpose(0, 2, 3, 1, 4, 5).reshape(n * rows * columns, inner * side * side)
    y = flat @ conv.weight.reshape(out, -1).T
    if conv.bias is not None:
        y = y + conv.bias
    return y.reshape(n, rows, columns, out).transpose(0, 3, 1, 2)


def relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0)


def memory_block(x: np.ndarray, block: MemoryBlock) -> np.ndarray:
    """Applies a memory block to `[time, channels, H, W]`."""
    before = np.concatenate((np.zeros_like(x[:1]), x[:-1]))
    y = relu(convolve(np.concatenate((x, before), axis=1), block.conv0))
    return relu(convolve(relu(convolve(y, block.conv2)), block.conv4) + x)


def upsample(x: np.ndarray) -> np.ndarray:
    """Nearest-neighbour upsampling by two."""
    return x.repeat(2, axis=2).repeat(2, axis=3)


def encode(weights: EncoderWeights, rgb: np.ndarray) -> np.ndarray:
    """Pictures `[4, 3, H, W]` in [0, 1] -> one latent `[C, h, w]`."""
    n, channels, H, W = rgb.shape
    x = rgb.reshape(n, channels, H // 2, 2, W // 2, 2).transpose(0, 1, 3, 5, 2, 4)
    x = x.reshape(n, channels * 4, H // 2, W // 2)
    x = relu(convolve(x, weights.first))
    for stage in weights.stages:
        _, c, rows, columns = x.shape
        together = stage.pool.weight.shape[1] // c
        x = convolve(x.reshape(-1, together * c, rows, columns), stage.pool)
        x = convolve(x, stage.down, stride=2)
        for block in stage.memory:
            x = memory_block(x, block)
    latent = convolve(x, weights.last)
    assert latent.shape[0] == 1, "four pictures make one latent"
    return latent[0]


def decode(weights: DecoderWeights, latents: np.ndarray, priming: int = PRIMING) -> tuple[np.ndarray, list[np.ndarray]]:
    """Latents `[n, C, h, w]` since the last reset -> pictures `[n, 4, 3, H, W]`, and the nine inputs that the memory blocks
    carry to the next latent, per latent: each `[n, channels, rows, columns]`."""
    n = len(latents)
    x = np.concatenate((np.repeat(latents[:1], priming, axis=0), latents))
    total = len(x)
    memories = []
    x = relu(convolve(np.tanh(x / 3) * 3, weights.first))
    for stage in weights.stages:
        for block in stage.memory:
            per_latent = len(x) // total
            memories.append(x[per_latent - 1 :: per_latent][priming:])
            x = memory_block(x, block)
        x = convolve(upsample(x), stage.grow)
        steps = stage.grow.weight.shape[0] // stage.grow.weight.shape[1]
        if steps > 1:
            x = x.reshape(len(x) * steps, x.shape[1] // steps, *x.shape[2:])
        x = convolve(x, stage.project)
    x = convolve(relu(x), weights.last)
    count, channels, H, W = x.shape
    x = x.reshape(count, channels // 4, 2, 2, H, W).transpose(0, 1, 4, 2, 5, 3)
    pictures = np.clip(x, 0, 1).reshape(total, count // total, channels // 4, 2 * H, 2 * W)
    return pictures[priming:], memories


def resize(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """Bilinear, half-pixel centres, clamped at the edges: `[channels, H, W]` -> `[channels, height, width]`."""

    def taps(size: int, wanted: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = np.maximum((np.arange(wanted) + 0.5) * size / wanted - 0.5, 0)
        low = np.minimum(at.astype(int), size - 1)
        return low, np.minimum(low + 1, size - 1), at - low

    low, high, t = taps(picture.shape[2], width)
    picture = picture[:, :, low] * (1 - t) + picture[:, :, high] * t
    low, high, t = taps(picture.shape[1], height)
    t = t[:, None]
    return picture[:, low] * (1 - t) + picture[:, high] * t

"""Numbers that follow from a seed: weights, input clips, weights of a loss. See ../goldens/README.md."""
import numpy as np


def uniform(seed, count):
    """The first `count` numbers of a seed's splitmix64 stream, in [0, 1), float64."""
    j = np.arange(1, count + 1, dtype=np.uint64)
    z = np.uint64(seed) + j * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)).astype(np.float64) * 2.0**-53


def signed(seed, shape):
    """Uniform in [-1, 1), float32."""
    return (2 * uniform(seed, int(np.prod(shape))) - 1).astype(np.float32).reshape(shape)


def weight(weight_seed, index, shape, factor=1.0):
    """Kernel (Glorot's bound) or bias (0.1) number `index` of a model, in TensorFlow's layout, float32."""
    receptive = np.prod(shape[:-2])
    limit = np.sqrt(6 / (receptive * (shape[-2] + shape[-1]))) if len(shape) > 1 else 0.1
    u = uniform(weight_seed * 1000 + index, int(np.prod(shape)))
    return ((2 * u - 1) * limit * factor).astype(np.float32).reshape(shape)


def clips(weight_seed, batch, time, side):
    """Input clips [batch, time, side, side, 3]: noise, and in each colour channel a blob that drifts; float32."""
    x = 0.1 * uniform(weight_seed + 7, batch * time * side * side * 3).reshape(batch, time, side, side, 3)
    c = uniform(weight_seed + 8, batch * 12).reshape(batch, 1, 3, 4)
    t = np.arange(time).reshape(1, time, 1)
    cy = side * (0.2 + 0.6 * c[..., 0]) + (c[..., 2] - 0.5) * t
    cx = side * (0.2 + 0.6 * c[..., 1]) + (c[..., 3] - 0.5) * t
    rows, columns = np.arange(side).reshape(side, 1, 1), np.arange(side).reshape(1, side, 1)
    squared = (rows - cy[:, :, None, None]) ** 2 + (columns - cx[:, :, None, None]) ** 2
    return np.clip(x + 0.9 * np.exp(-squared / (2 * (side / 12) ** 2)), 0, 1).astype(np.float32)

"""Layers, up-sampling, the two U-Nets, learned variables (original: blocks.py)."""
import numpy as np
import tensorflow as tf


class Variables(dict):
    """All variables by their names; one that is not there is made with Glorot's initial values."""

    def __init__(self, given=None, dtype="float32", seed=0):
        super().__init__({name: tf.Variable(x) for name, x in (given or {}).items()})
        self.dtype, self.random = dtype, np.random.default_rng(seed)

    def get(self, name, shape):
        if name not in self:
            limit = np.sqrt(6 / (np.prod(shape[:-2]) * (shape[-2] + shape[-1]))) if len(shape) > 1 else 0.0
            self[name] = tf.Variable(self.random.uniform(-limit, limit, shape).astype(self.dtype))
        if self[name].shape != shape:
            raise ValueError(f"variable {name}: shape {self[name].shape}, expected {shape}")
        return self[name]


class Scope:
    """One pass through a scope: its layers are numbered conv2d, conv2d_1, .., dense, dense_1, .. as they are used."""

    def __init__(self, variables, name):
        self.variables, self.name, self.counts = variables, name, {}

    def scalar(self, name):
        return self.variables.get(f"{self.name}/{name}", [])

    def kernel_and_bias(self, kind, shape):
        index = self.counts.get(kind, 0)
        self.counts[kind] = index + 1
        name = f"{self.name}/{kind}" + (f"_{index}" if index else "")
        return self.variables.get(f"{name}/kernel", shape), self.variables.get(f"{name}/bias", shape[-1:])

    def conv2d(self, x, filters, size=3, activation=tf.nn.relu):
        kernel, bias = self.kernel_and_bias("conv2d", [size, size, x.shape[-1], filters])
        x = tf.nn.conv2d(x, kernel, 1, "SAME") + bias
        return x if activation is None else activation(x)

    def dense(self, x, units, activation=None):
        kernel, bias = self.kernel_and_bias("dense", [x.shape[-1], units])
        x = x @ kernel + bias
        return x if activation is None else activation(x)


def resize_bilinear(x):
    """[B, H, W, C] to twice the size. TensorFlow 1's own operation, which knows float32 only; else the same by hand."""
    if x.dtype == tf.float32:
        size = [2 * x.shape[1], 2 * x.shape[2]]
        return tf.raw_ops.ResizeBilinear(images=x, size=size, align_corners=False, half_pixel_centers=False)
    for axis in (1, 2):
        following = tf.gather(x, [*range(1, x.shape[axis]), x.shape[axis] - 1], axis=axis)
        shape = [*x.shape]
        shape[axis] *= 2
        x = tf.reshape(tf.stack([x, (x + following) / 2], axis + 1), shape)
    return x


def pool(x):
    return tf.nn.max_pool2d(x, 2, 2, "SAME")


def shallow_unet(scope, x, objects, base=8):
    """[B, S, S, 3] to mask logits [B, S, S, N]."""
    conv = scope.conv2d
    x1 = conv(conv(x, base), base)
    x2 = conv(conv(pool(x1), 2 * base), 2 * base)
    x3 = conv(conv(pool(x2), 4 * base), 4 * base)
    up = conv(resize_bilinear(x3), 2 * base, activation=None)
    x2 = conv(conv(tf.concat([up, x2], 3), 2 * base), 2 * base)
    up = conv(resize_bilinear(x2), 2 * base, activation=None)
    x1 = conv(conv(tf.concat([up, x1], 3), base), base)
    return conv(x1, objects, 1, None)


def unet(scope, x, objects, base=16):
    """As shallow_unet, one level deeper."""
    conv = scope.conv2d
    x1 = conv(conv(x, base), base)
    x2 = conv(conv(pool(x1), 2 * base), 2 * base)
    x3 = conv(conv(pool(x2), 4 * base), 4 * base)
    x4 = conv(conv(pool(x3), 8 * base), 8 * base)
    up = conv(resize_bilinear(x4), 2 * base, activation=None)
    x3 = conv(conv(tf.concat([up, x3], 3), 4 * base), 4 * base)
    up = conv(resize_bilinear(x3), 2 * base, activation=None)
    x2 = conv(conv(tf.concat([up, x2], 3), 2 * base), 2 * base)
    up = conv(resize_bilinear(x2), 2 * base, activation=None)
    x1 = conv(conv(tf.concat([up, x1], 3), base), base)
    return conv(x1, objects, 1, None)


def variable_from_network(scope, shape):
    """A learned array as the output of a small network on ones[1, 10]."""
    h = scope.dense(tf.ones([1, 10], scope.variables.dtype), 200, tf.tanh)
    return tf.reshape(scope.dense(h, int(np.prod(shape))), shape)

"""Layers, up-sampling, the two U-Nets, learned variables (original: blocks.py)."""
import torch
import torch.nn.functional as F
from torch import nn


class Scope(nn.Module):
    """A module whose layers are numbered as TensorFlow numbers them: conv2d, conv2d_1, .., dense, dense_1, .."""

    def __init__(self):
        super().__init__()
        self.counts = {}

    def numbered(self, kind, layer):
        index = self.counts.get(kind, 0)
        self.counts[kind] = index + 1
        self.add_module(kind if index == 0 else f"{kind}_{index}", layer)
        nn.init.xavier_uniform_(layer.weight)
        nn.init.zeros_(layer.bias)
        return layer

    def new_conv2d(self, inputs, outputs, size=3):
        return self.numbered("conv2d", nn.Conv2d(inputs, outputs, size, padding=size // 2))

    def new_dense(self, inputs, outputs):
        return self.numbered("dense", nn.Linear(inputs, outputs))


def resize_bilinear(x, half_pixel=False):
    """[B, C, H, W] to twice the size as TensorFlow 1 does it: out[2i] = in[i], out[2i+1] = (in[i] + in[i+1]) / 2."""
    if half_pixel:
        return F.interpolate(x, scale_factor=2, mode="bilinear", antialias=True)
    x = x.permute(0, 2, 3, 1)  # channels last, in which the convolutions are fastest
    for axis in (1, 2):
        n = x.shape[axis]
        following = torch.cat([x.narrow(axis, 1, n - 1), x.narrow(axis, n - 1, 1)], axis)
        x = torch.stack([x, (x + following) / 2], axis + 1).flatten(axis, axis + 1)
    return x.permute(0, 3, 1, 2)


def shallow_unet_layers(scope, objects, b=8):
    sizes = [(3, b), (b, b), (b, 2 * b), (2 * b, 2 * b), (2 * b, 4 * b), (4 * b, 4 * b),
             (4 * b, 2 * b), (4 * b, 2 * b), (2 * b, 2 * b),
             (2 * b, 2 * b), (3 * b, b), (b, b)]
    return [scope.new_conv2d(*size) for size in sizes] + [scope.new_conv2d(b, objects, 1)]


def unet_layers(scope, objects, b=16):
    sizes = [(3, b), (b, b), (b, 2 * b), (2 * b, 2 * b), (2 * b, 4 * b), (4 * b, 4 * b), (4 * b, 8 * b), (8 * b, 8 * b),
             (8 * b, 2 * b), (6 * b, 4 * b), (4 * b, 4 * b),
             (4 * b, 2 * b), (4 * b, 2 * b), (2 * b, 2 * b),
             (2 * b, 2 * b), (3 * b, b), (b, b)]
    return [scope.new_conv2d(*size) for size in sizes] + [scope.new_conv2d(b, objects, 1)]


def shallow_unet(c, x, half_pixel=False, relu_logits=False):
    """[B, 3, S, S] to mask logits [B, N, S, S]; c: the convolutions in their order."""
    c = iter(c)

    def conv(x):
        return F.relu(next(c)(x))

    x1 = conv(conv(x))
    x2 = conv(conv(F.max_pool2d(x1, 2)))
    x3 = conv(conv(F.max_pool2d(x2, 2)))
    up = next(c)(resize_bilinear(x3, half_pixel))
    x2 = conv(conv(torch.cat([up, x2], 1)))
    up = next(c)(resize_bilinear(x2, half_pixel))
    x1 = conv(conv(torch.cat([up, x1], 1)))
    logits = next(c)(x1)
    return F.relu(logits) if relu_logits else logits


def unet(c, x, half_pixel=False, relu_logits=False):
    """As shallow_unet, one level deeper."""
    c = iter(c)

    def conv(x):
        return F.relu(next(c)(x))

    x1 = conv(conv(x))
    x2 = conv(conv(F.max_pool2d(x1, 2)))
    x3 = conv(conv(F.max_pool2d(x2, 2)))
    x4 = conv(conv(F.max_pool2d(x3, 2)))
    up = next(c)(resize_bilinear(x4, half_pixel))
    x3 = conv(conv(torch.cat([up, x3], 1)))
    up = next(c)(resize_bilinear(x3, half_pixel))
    x2 = conv(conv(torch.cat([up, x2], 1)))
    up = next(c)(resize_bilinear(x2, half_pixel))
    x1 = conv(conv(torch.cat([up, x1], 1)))
    logits = next(c)(x1)
    return F.relu(logits) if relu_logits else logits


class VariableFromNetwork:
    """A learned array as the output of a small network on ones[1, 10]; its layers belong to `scope`."""

    def __init__(self, scope, shape):
        self.hidden = scope.new_dense(10, 200)
        self.output = scope.new_dense(200, torch.Size(shape).numel())
        self.shape = shape

    def __call__(self):
        ones = torch.ones(1, 10, dtype=self.hidden.weight.dtype, device=self.hidden.weight.device)
        return self.output(torch.tanh(self.hidden(ones))).reshape(self.shape)

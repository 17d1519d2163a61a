"""The spatial transformer without rotation as two small matrix products, several times faster than gathering pixels.

The values are those of ../stn.py: each row of a matrix holds the weights of the source pixels of one output pixel.
"""
import torch

from ..stn import indices_and_weights, stn


def separable_stn(images, theta, side, grid_sample=False):
    """As `stn`, for theta of the form [sx, 0, x, 0, sy, y]."""
    if grid_sample:
        return stn(images, theta, side, grid_sample)
    height, width = images.shape[2:]
    line = torch.linspace(-1, 1, side, dtype=images.dtype)
    columns = weights_of_source(theta[:, :1] * line + theta[:, 2:3], width)
    rows = weights_of_source(theta[:, 4:5] * line + theta[:, 5:6], height)
    return rows[:, None] @ images @ columns[:, None].transpose(2, 3)


def weights_of_source(source, size):
    """[batch, side, size]."""
    low, high, w_low, w_high = indices_and_weights(source, size)
    index = torch.arange(size, device=source.device)
    return (low[..., None] == index) * w_low[..., None] + (high[..., None] == index) * w_high[..., None]

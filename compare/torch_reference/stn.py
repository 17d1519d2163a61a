"""The spatial transformer (original: stn.py)."""
import torch
import torch.nn.functional as F


def stn(images, theta, side, grid_sample=False):
    """Samples images [B, C, h, w] under theta [B, 6] into [B, C, side, side]."""
    batch, channels, height, width = images.shape
    theta = theta.reshape(batch, 2, 3)
    if grid_sample:
        grid = F.affine_grid(theta, [batch, channels, side, side], align_corners=False)
        return F.grid_sample(images, grid, align_corners=False)
    line = torch.linspace(-1, 1, side, dtype=images.dtype)
    gx, gy = line.repeat(side), line.repeat_interleave(side)
    source = theta @ torch.stack([gx, gy, torch.ones_like(gx)])  # [B, 2, side * side]
    x0, x1, wx0, wx1 = indices_and_weights(source[:, 0], width)
    y0, y1, wy0, wy1 = indices_and_weights(source[:, 1], height)
    flat = images.flatten(2)

    def gather(y, x):
        index = (y * width + x).long()[:, None].expand(-1, channels, -1)
        return flat.gather(2, index)

    sampled = ((wx0 * wy0)[:, None] * gather(y0, x0) + (wx0 * wy1)[:, None] * gather(y1, x0)
               + (wx1 * wy0)[:, None] * gather(y0, x1) + (wx1 * wy1)[:, None] * gather(y1, x1))
    return sampled.reshape(batch, channels, side, side)


def indices_and_weights(source, size):
    """Pixels below and above, clipped to the image, and their weights, taken from the clipped indices."""
    pixel = (source + 1) * (size - 1.01) / 2
    below = pixel.detach().floor()
    low, high = below.clamp(0, size - 1), (below + 1).clamp(0, size - 1)
    return low, high, high - pixel, pixel - low

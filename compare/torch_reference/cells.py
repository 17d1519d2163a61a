"""Physics cells (original: cells.py): pos and vel are [B, 2 N] as (x0, y0, x1, y1, ..), one call is one frame."""
import torch
from torch import nn

SUBSTEPS = 5


class BouncingCell(nn.Module):
    def __init__(self, side=32, radius=2.0, defects=None):
        super().__init__()
        self.near, self.far = radius, side - radius

    def forward(self, pos, vel, dt):
        near, far = self.near, self.far
        for _ in range(SUBSTEPS):
            pos = pos + dt / SUBSTEPS * vel
            vel = torch.where(pos > far, -vel, vel)
            vel = torch.where(pos < near, -vel, vel)
            pos = torch.where(pos > far, 2 * far - pos, pos)
            pos = torch.where(pos < near, 2 * near - pos, pos)
        return pos, vel


class SpringCell(nn.Module):
    def __init__(self, side=None, defects=None):
        super().__init__()
        self.log_k = nn.Parameter(torch.zeros(()))
        self.log_l = nn.Parameter(torch.zeros(()))
        self.defects = defects

    def forward(self, pos, vel, dt):
        h = dt / SUBSTEPS
        # Defect 2: PyTorch's split takes the size of a part, TensorFlow's the number of parts.
        size = 1 if self.defects and self.defects.split_by_size else 2
        for _ in range(SUBSTEPS):
            p0, p1 = torch.split(pos, size, 1)[:2]
            v0, v1, *rest = torch.split(vel, size, 1)
            d = p0 - p1
            n = torch.sqrt(torch.sum(d**2, 1, keepdim=True))
            force = torch.exp(self.log_k) * (n - 2 * torch.exp(self.log_l)) * d / (n + 1e-4)
            vel = torch.cat([v0 - h * force, v1 + h * force, *rest], 1)
            pos = pos + h * vel
        return pos, vel


class GravityCell(nn.Module):
    """`log_m` is fixed: only g m^2 enters."""

    def __init__(self, side=None, log_m=0.0, defects=None):
        super().__init__()
        self.log_g = nn.Parameter(torch.zeros(()))
        self.log_m = log_m
        self.defects = defects
        self.stale = None

    def strength(self):
        a = torch.exp(self.log_g) * torch.exp(torch.as_tensor(2 * self.log_m))
        if self.defects and self.defects.strength_once:  # defect 12
            self.stale = a.detach() if self.stale is None else self.stale
            return self.stale
        return a

    def forward(self, pos, vel, dt):
        h = dt / SUBSTEPS
        for _ in range(SUBSTEPS):
            p0, p1, p2 = torch.split(pos, 2, 1)
            f01, f12, f20 = attraction(p0 - p1), attraction(p1 - p2), attraction(p2 - p0)
            force = -self.strength() * torch.cat([f01 - f20, f12 - f01, f20 - f12], 1)
            vel = vel + h * force
            pos = pos + h * vel
        return pos, vel


def attraction(d):
    n = torch.sqrt(torch.clamp(torch.sum(d**2, 1, keepdim=True), 0.1, 1e5))
    return d / torch.clamp(n, 1, 170) ** 3


CELLS = {"bouncing_ode_cell": BouncingCell, "spring_ode_cell": SpringCell, "gravity_ode_cell": GravityCell}

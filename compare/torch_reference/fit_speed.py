"""The fit of the parameters, timed as the port's `speed --what identify`: to the same positions, from the same start."""
import math

import torch

from .cells import CELLS
from .training.identify import identify
from .training.refinement import trajectory

TRUE = {"spring_color": {"log_k": math.log(4), "log_l": math.log(6)}, "3bp_color": {"log_g": math.log(60)}}
FIT = {"horizons": [3, 4, 6, 8], "max_iterations": 30, "huber": 1.0}


def scattered(purpose, *size):
    """Numbers between -1 and 1 without an order (compare/speed.rs)."""
    i = torch.arange(math.prod(size), dtype=torch.float64)
    wide = 43758.5453 * torch.sin(1_000_000 * purpose + i + 1)
    return (2 * (wide - wide.floor()) - 1).reshape(size)


@torch.no_grad()
def positions(task, clips):
    """[clips, frames, 2 N], pixels: objects that begin on a ring, seen with an error."""
    n, side, frames = task.objects, task.side, task.seq_len
    angles = [2 * math.pi * i / n for i in range(n)]
    ring = [side / 2 + side / 4 * f(angle) for angle in angles for f in (math.sin, math.cos)]
    pos = torch.tensor(ring, dtype=torch.float64) + scattered(0, clips, 2 * n) * (side / 20)
    cell = CELLS[task.cell](side=side)
    for name, number in TRUE[task.key].items():
        getattr(cell, name).fill_(number)
    first = torch.cat([pos, scattered(1, clips, 2 * n) * (side / 10)], 1)
    seen = trajectory(cell, task.dt, first, frames - 1).reshape(clips, frames, 2 * n)
    return seen + scattered(2, clips, frames, 2 * n) / 20


def fit(task, clips):
    """A function that fits once, from the original's start."""
    seen, frames = positions(task, clips), task.seq_len
    config = FIT | {"horizons": [horizon for horizon in FIT["horizons"] if horizon < frames] + [frames]}
    return lambda: identify(config, CELLS[task.cell](side=task.side), task.dt, seen)

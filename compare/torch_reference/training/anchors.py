"""What moves, clustered by colour into as many groups as there are objects (the port's `discover`)."""
import torch

from .data import generator

SAMPLES, MOVES, FAINT, WIDTH = 5000, 0.5, 0.02, 0.1
STARTS, UPDATES = 8, 20
EXPLAINED = 0.8


def directions(frames, median):
    """Of the difference from the median in colour space, [frames, 3, S, S]; short where it is faint."""
    difference = frames - median
    return difference / (difference.norm(dim=1, keepdim=True) + FAINT)


def find_anchors(frames, median, moving, objects, seed):
    """Colour directions [objects, 3]; None where colours do not tell the objects apart."""
    samples = directions(frames, median).movedim(1, 3)[moving > MOVES]
    if len(samples) < objects:
        return None
    samples = samples[::max(1, len(samples) // SAMPLES)]
    random = generator(seed, "colour anchors")
    centres, within = min((cluster(samples, objects, random) for _ in range(STARTS)), key=lambda found: found[1])
    total = torch.sum((samples - samples.mean(0)) ** 2)
    return centres if 1 - within / total > EXPLAINED else None


def claims(anchors, frames, median):
    """Each object's claim on each pixel, [frames, objects, S, S]."""
    squared = torch.sum((directions(frames, median)[:, None] - anchors[:, :, None, None]) ** 2, 2)
    return torch.softmax(-squared / WIDTH, 1)


def cluster(samples, groups, random):
    """k-means from a k-means++ start: centres and the sum of squares within the groups."""
    centres = samples[[random.integers(len(samples))]]
    while len(centres) < groups:
        nearest = squared_distances(samples, centres).min(1).values.double()
        place = random.choice(len(samples), p=(nearest / nearest.sum()).numpy())
        centres = torch.cat([centres, samples[[place]]])
    for _ in range(UPDATES):
        members = torch.nn.functional.one_hot(squared_distances(samples, centres).argmin(1), groups).float()
        centres = members.T @ samples / members.sum(0).clamp(min=1)[:, None]
    return centres, squared_distances(samples, centres).min(1).values.sum().item()


def squared_distances(samples, centres):
    return torch.sum((samples[:, None] - centres) ** 2, 2)

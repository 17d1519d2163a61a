"""Guides for the encoder's masks while objects are being found; they fade out (`discover.guide`)."""
import math

import torch
import torch.nn.functional as F

EMPTY, LEAST_MASK = 1e-3, 1e-30


def moving(frames, median, temperature):
    """What moves in each pixel, [frames, S, S] in [0, 1)."""
    return 1 - torch.exp(-(frames - median).abs().sum(1) / temperature)


def fade(guide, step):
    """1, then half a cosine down to 0."""
    share = (step - guide["full_until"]) / (guide["zero_from"] - guide["full_until"])
    return 0.5 * (1 + math.cos(math.pi * min(max(share, 0), 1)))


def guides_loss(guide, pos, masks, moves, claimed, centres):
    """`moves`: see `moving`; `claimed`: by colour, or None; `centres`: the position of each pixel index of an axis."""
    objects, side = masks.shape[1] - 1, masks.shape[-1]
    object_masks, background = masks[:, :objects], masks[:, objects]
    some_object = object_masks.sum(1).clamp(min=LEAST_MASK)
    moving_in_all = moves.sum((1, 2)) + EMPTY

    # Coverage: some object's mask where something moves, the background's elsewhere, both areas weighing the same.
    static = torch.sum((1 - moves) * background.clamp(min=LEAST_MASK).log(), (1, 2)) / (side**2 - moving_in_all)
    coverage = -torch.mean(torch.sum(moves * some_object.log(), (1, 2)) / moving_in_all + static)

    # What each object owns of what moves, the background left out: its mass and its centroid.
    among = object_masks / some_object[:, None]
    owned = among * moves[:, None]
    mass, by_row, by_column = owned.sum((2, 3)), owned.sum(3), owned.sum(2)
    x, y = (torch.sum(along * centres, 2) / (mass + EMPTY) for along in (by_column, by_row))

    # Compactness: variance of what an object owns.
    def spread(along, centre):
        return torch.sum(along * (centres - centre[..., None]) ** 2, (1, 2)) / moving_in_all

    compactness = torch.mean(spread(by_column, x) + spread(by_row, y)) / side**2

    # Balance: no object without its share.
    owned_share = mass / moving_in_all[:, None]
    share = owned_share.mean(0) / owned_share.mean(0).sum()
    balance = -torch.mean(torch.log(share + 1e-8)) - math.log(objects)

    # Tie: the position at the centroid, as far as the object owns anything.
    centroids = torch.stack([x, y], 2).detach()
    owns = (objects * owned_share).clamp(max=1).detach()
    distance = F.smooth_l1_loss(pos.reshape(-1, objects, 2), centroids, reduction="none")
    tie = torch.mean(torch.sum(distance.sum(2) * owns, 1))

    loss = (guide["coverage"] * coverage + guide["compactness"] * compactness + guide["balance"] * balance
            + guide["tie"] * tie)
    if claimed is not None:
        colour = -torch.sum(moves[:, None] * claimed * among.clamp(min=LEAST_MASK).log()) / moving_in_all.sum()
        loss = loss + guide["colour"] * colour
    return loss

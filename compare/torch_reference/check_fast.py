"""Whether the reference that is timed computes what the one that is read does: python -m torch_reference.check_fast

Loss and gradients of a training step of each task, in double precision, from the same weights and clips. Exit code 1: they
differ by more than their rounding.
"""
import sys

import torch

from shared.tasks import TASKS

from .fast import FastNet
from .physics_models import PhysicsNet

# Of a tensor's largest element: sums of some thousand products in another order.
TOLERANCE = 1e-9


def apart(a, b):
    return float(((a - b).abs().max() / b.abs().max().clamp_min(1e-300)).detach())


def compare(task):
    """The largest differences of loss and gradients."""
    read, timed = PhysicsNet(task), FastNet(task)
    with torch.no_grad():
        # Initial biases are 0, and templates of one shade have no gradient by the position.
        for parameter in read.parameters():
            parameter += 0.1 * torch.randn_like(parameter)
    timed.load_state_dict(read.state_dict())
    clips = torch.rand(2, task.seq_len, task.side, task.side, 3)
    losses = [read(clips).train_loss, timed.step(clips.permute(0, 1, 4, 2, 3))]
    for loss in losses:
        loss.backward()
    gradients = [(p.grad, q.grad) for p, q in zip(timed.parameters(), read.parameters()) if q.grad is not None]
    return apart(losses[1], losses[0]), max(apart(timed, read) for timed, read in gradients)


def main():
    torch.manual_seed(0)
    torch.set_default_dtype(torch.float64)
    good = True
    for key, task in TASKS.items():
        loss, gradients = compare(task)
        good &= max(loss, gradients) < TOLERANCE
        print(f"{key}: loss {loss:.1e}, gradients {gradients:.1e} apart")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()

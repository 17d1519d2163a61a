"""The estimated state, improved by Gauss-Newton steps on all input positions under the present physics.

The velocity estimator sees one object at a time and cannot know the forces between them. States are [batch, 4 N], positions then velocities, at the first input frame.
"""
import torch

DAMPING = 1e-2
LARGEST_STEP = 5.0
PROBE = 0.05


def refine(cell, dt, positions, velocity, steps):
    """(position, velocity) at the last of the input positions [batch, L, 2 N]."""
    frames = positions.shape[1] - 1
    start = best_start(cell, dt, positions, velocity, steps - 1)
    first = gauss_newton_step(cell, dt, start, positions.flatten(1), frames)
    pos, vel = first.chunk(2, 1)
    for _ in range(frames):
        pos, vel = cell(pos, vel, dt)
    return pos, vel


@torch.no_grad()
def best_start(cell, dt, positions, velocity, steps):
    """Of the estimate and of each difference of neighbouring frames, rolled back: what fits best after some steps."""
    frames = positions.shape[1] - 1
    starts = [rolled_back(cell, dt, positions[:, -1], velocity, frames)]
    for frame in range(frames):
        now, following = positions[:, frame], positions[:, frame + 1]
        starts.append(rolled_back(cell, dt, now, (following - now) / dt, frame))
    first, observed = torch.cat(starts), positions.flatten(1).repeat(len(starts), 1)
    for _ in range(steps):
        first = gauss_newton_step(cell, dt, first, observed, frames)
    misfit = torch.sum((trajectory(cell, dt, first, frames) - observed) ** 2, 1).reshape(len(starts), -1)
    return first.reshape(len(starts), *starts[0].shape)[misfit.argmin(0), torch.arange(len(positions))]


def rolled_back(cell, dt, pos, vel, frames):
    for _ in range(frames):
        pos, vel = cell(pos, vel, -dt)
    return torch.cat([pos, vel], 1)


def gauss_newton_step(cell, dt, first, observed, frames):
    """Differentiable with the Jacobian held fixed."""
    inverse = pseudo_inverse(jacobian(cell, dt, first.detach(), frames))
    residual = trajectory(cell, dt, first, frames) - observed
    step = (inverse @ residual.unsqueeze(-1)).squeeze(-1)
    return first - step.clamp(-LARGEST_STEP, LARGEST_STEP)


def trajectory(cell, dt, first, frames):
    """Positions of all frames, [batch, (frames + 1) * 2 N]."""
    pos, vel = first.chunk(2, 1)
    positions = [pos]
    for _ in range(frames):
        pos, vel = cell(pos, vel, dt)
        positions.append(pos)
    return torch.cat(positions, 1)


@torch.no_grad()
def jacobian(cell, dt, first, frames, probe=PROBE):
    """Of the trajectory by the first state, by central differences; all perturbed copies roll out as one batch."""
    batch, unknowns = first.shape
    probes = probe * torch.eye(unknowns, dtype=first.dtype)
    copies = (first[:, None] + torch.cat([probes, -probes])).flatten(0, 1)
    up, down = trajectory(cell, dt, copies, frames).reshape(batch, 2, unknowns, -1).unbind(1)
    return ((up - down) / (2 * probe)).transpose(1, 2)


@torch.no_grad()
def pseudo_inverse(j):
    """(J^T J + damping)^-1 J^T."""
    transposed = j.transpose(1, 2).double()
    normal = transposed @ transposed.transpose(1, 2) + DAMPING * torch.eye(j.shape[2], dtype=torch.float64)
    return torch.linalg.solve(normal, transposed).to(j.dtype)

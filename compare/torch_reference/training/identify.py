"""Fits the physical parameters to encoded trajectories, without images (the port's `identify`).

From poor parameters the image loss leads to free motion (k to 0); trajectories of growing length have no such trap.
Levenberg-Marquardt in double precision with a Huber loss; unknown are the log-parameters, one offset of each object's
template, and each clip's first state, which is eliminated clip by clip.
"""
from dataclasses import dataclass

import torch
from torch.func import functional_call

from .refinement import jacobian, trajectory

PROBE, OFFSET_RIDGE, LARGEST_LOG_STEP = 1e-4, 1e-3, 0.5
DAMPING, DAMPING_UP, DAMPING_DOWN, DAMPING_LIMIT = 1e-2, 8.0, 0.3, 1e8
CONVERGED = 1e-5


@dataclass
class Unknowns:
    logs: torch.Tensor
    offsets: torch.Tensor   # [2 N]
    states: torch.Tensor    # [clips, 4 N]

    def moved(self, shared, states):
        logs, offsets = shared.split([len(self.logs), len(self.offsets)])
        return Unknowns(self.logs + logs, self.offsets + offsets, self.states + states)


class Problem:
    """`positions`: [clips, frames, 2 N], double; only the first `horizon` frames count."""

    def __init__(self, cell, dt, huber, positions, horizon):
        self.cell, self.names = cell, [name for name, _ in cell.named_parameters()]
        self.dt, self.huber, self.horizon = dt, huber, horizon
        self.seen, self.ridge = positions[:, :horizon].flatten(1), OFFSET_RIDGE * len(positions)

    def stepper(self, logs):
        values = dict(zip(self.names, logs))
        return lambda pos, vel, dt: functional_call(self.cell, values, (pos, vel, dt))

    def roll_out(self, logs, states):
        return trajectory(self.stepper(logs), self.dt, states, self.horizon - 1)

    def residual(self, at):
        return self.roll_out(at.logs, at.states) + at.offsets.repeat(self.horizon) - self.seen

    def cost(self, at):
        size = self.residual(at).abs()
        huber = torch.where(size <= self.huber, 0.5 * size**2, self.huber * (size - 0.5 * self.huber))
        return (huber.sum() + 0.5 * self.ridge * torch.sum(at.offsets**2)).item()

    def by_shared(self, at):
        """Derivatives of the residuals by log-parameters and offsets, [clips, residuals, shared]."""
        columns = []
        for probe in PROBE * torch.eye(len(at.logs), dtype=torch.float64):
            up, down = self.roll_out(at.logs + probe, at.states), self.roll_out(at.logs - probe, at.states)
            columns.append(((up - down) / (2 * PROBE))[..., None])
        offsets = torch.eye(len(at.offsets), dtype=torch.float64).repeat(self.horizon, 1)
        return torch.cat([*columns, offsets.expand(len(at.states), -1, -1)], 2)

    def linearise(self, at):
        by_state = jacobian(self.stepper(at.logs), self.dt, at.states, self.horizon - 1, PROBE)
        return self.residual(at)[..., None], by_state, self.by_shared(at)

    def step(self, linearised, at, damping):
        """The damped Gauss-Newton step of the shared unknowns and of the states."""
        residual, by_state, by_shared = linearised
        weight = self.huber / residual.abs().clamp(min=self.huber)
        w_state, w_shared = ((weight * j).transpose(1, 2) for j in (by_state, by_shared))

        def damped(normal):
            return normal + torch.diag_embed(damping * normal.diagonal(dim1=-2, dim2=-1) + 1e-9)

        state_shared = w_state @ by_shared
        right = torch.cat([state_shared, w_state @ residual], 2)
        a_b, a_g = torch.linalg.solve(damped(w_state @ by_state), right).split([by_shared.shape[2], 1], 2)
        held = torch.cat([torch.zeros_like(at.logs), torch.full_like(at.offsets, self.ridge)])
        normal = damped(torch.sum(w_shared @ by_shared, 0) + torch.diag(held))
        normal = normal - torch.sum(state_shared.transpose(1, 2) @ a_b, 0)
        gradient = torch.sum(w_shared @ residual - state_shared.transpose(1, 2) @ a_g, 0)[:, 0]
        shared = -torch.linalg.solve(normal, gradient + held * torch.cat([at.logs, at.offsets]))
        shared = shared * min(1.0, LARGEST_LOG_STEP / (shared[:len(at.logs)].abs().max().item() or 1.0))
        return shared, -(a_g[..., 0] + a_b @ shared)

    def minimise(self, at, iterations):
        cost, damping = self.cost(at), DAMPING
        for _ in range(iterations):
            linearised = self.linearise(at)
            while True:
                following = at.moved(*self.step(linearised, at, damping))
                following_cost = self.cost(following)
                if following_cost < cost:
                    break
                damping *= DAMPING_UP
                if damping > DAMPING_LIMIT:
                    return at
            fall = (cost - following_cost) / cost
            at, cost, damping = following, following_cost, damping * DAMPING_DOWN
            if fall < CONVERGED:
                break
        return at


@torch.no_grad()
def identify(config, cell, dt, positions):
    """Fits a cell's parameters in place; gives the objects' offsets and the residual's root mean square in pixels."""
    positions = positions.double()
    first, following = positions[:, 0], positions[:, 1]
    parameters = list(cell.parameters())
    at = Unknowns(torch.stack([p.detach().double() for p in parameters]), torch.zeros_like(first[0]),
                  torch.cat([first, (following - first) / dt], 1))
    for horizon in config["horizons"]:
        problem = Problem(cell, dt, config["huber"], positions, horizon)
        at = problem.minimise(at, config["max_iterations"])
    for p, log in zip(parameters, at.logs):
        p.copy_(log)
    return at.offsets, problem.residual(at).square().mean().sqrt().item()

"""The reference network with what the fast recipe puts around it: exact shift, centred velocity input, refinement."""
from dataclasses import dataclass

import torch
import torch.nn.functional as F

from ..physics_models import PhysicsNet, frame_error
from .refinement import refine
from .separable_stn import separable_stn


@dataclass
class Pass:
    recons_loss: torch.Tensor
    pred_loss: torch.Tensor
    enc_pos: torch.Tensor      # [batch, time, 2 N]
    rolled_out: torch.Tensor   # [batch, T_pred, 2 N]
    velocity: torch.Tensor     # estimated from the detached positions, [batch, 2 N]
    refined: torch.Tensor      # the refined velocity


class FastNet:
    def __init__(self, training, options):
        self.task, self.defects, self.options = training.task, training.defects, options
        self.net = PhysicsNet(self.task, self.defects)
        self.net.decoder.stn = separable_stn
        self.cell = getattr(self.net, self.task.cell)

    def render(self, pos):
        """The decoder moves a template by (S - 1) / S pixels for one unit of position; here by one pixel."""
        s = self.task.side
        if self.options["exact_shift"]:
            pos = s / 2 + (pos - s / 2) * (s / (s - 1))
        return self.net.decoder(pos)[0]

    def velocity(self, input_pos):
        half = self.task.side / 2
        return self.net.init_vel((input_pos - half) / half if self.options["centred_velocity_input"] else input_pos)

    def initial_state(self, enc_pos):
        """Defect 3 starts from the wrong frame's position, and with the velocity at the right one."""
        task = self.task
        input_pos = enc_pos[:, :task.input_steps]
        vel = self.velocity(input_pos)
        pos, vel = refine(self.cell, task.dt, input_pos, vel, self.options["refinement_steps"])
        return (enc_pos[:, task.input_steps + 1] if self.defects.late_start else pos), vel

    def training_frames(self):
        """Frames of a training clip: L + T_pred, so that its last T_pred follow the input; all with defect 3."""
        return self.task.seq_len if self.defects.late_start else self.task.input_steps + self.task.pred_steps

    def __call__(self, clips):
        """Clips [batch, time, 3, S, S]; the loss of the prediction is taken over their last T_pred frames."""
        task, batch, time = self.task, *clips.shape[:2]
        enc_pos = self.net.encoder(clips.flatten(0, 1))[0].reshape(batch, time, -1)
        pos, refined = self.initial_state(enc_pos)
        rolled_out, vel = [], refined
        for _ in range(task.pred_steps):
            pos, vel = self.cell(pos, vel, task.dt)
            rolled_out.append(pos)
        rolled_out = torch.stack(rolled_out, 1)
        reconstructed = task.input_steps + task.pred_steps
        drawn = self.render(torch.cat([enc_pos[:, :reconstructed], rolled_out], 1).flatten(0, 1))
        drawn = drawn.reshape(batch, -1, *clips.shape[2:])
        return Pass(
            recons_loss=frame_error(drawn[:, :reconstructed], clips[:, :reconstructed]),
            pred_loss=frame_error(drawn[:, reconstructed:], clips[:, -task.pred_steps:]),
            enc_pos=enc_pos, rolled_out=rolled_out, refined=refined,
            velocity=self.velocity(enc_pos[:, :task.input_steps].detach()))

    @torch.no_grad()
    def scores(self, clips, limit=None, batch=25):
        """Mean L_rec and L_pred of a split, defect or not by the original's frames."""
        count = min(len(clips), limit or len(clips))
        frames, sums = self.task.input_steps + self.task.pred_steps, torch.zeros(2)
        for first in range(0, count, batch):
            chosen = range(first, min(first + batch, count))
            done = self(clips.batch(chosen, frames))
            sums += len(chosen) * torch.stack([done.recons_loss, done.pred_loss])
        return (sums / count).tolist()

    @torch.no_grad()
    def autoencoder_score(self, frames, batch=250):
        losses = [self.autoencoder_loss(part)[0] * len(part) for part in frames.split(batch)]
        return float(sum(losses)) / len(frames)

    def autoencoder_loss(self, frames):
        """(L_rec, positions, masks) of single frames [batch, 3, S, S]."""
        pos, masks, _ = self.net.encoder(frames)
        return frame_error(self.render(pos)[:, None], frames[:, None]), pos, masks

    def parameters(self):
        """The physical parameters by symbol, lengths in true pixels."""
        pixels = 1.0 if self.options["exact_shift"] else (self.task.side - 1) / self.task.side
        powers = {"l": 1, "g": 3}
        values = {name.removeprefix("log_"): p.exp().item() for name, p in self.cell.named_parameters()}
        return {name: value * pixels ** powers.get(name, 0) for name, value in values.items()}


def latent_error(x, target):
    """Smooth L1; the target is detached: it teaches physics and initial state, not the encoder."""
    return F.smooth_l1_loss(x, target.detach())

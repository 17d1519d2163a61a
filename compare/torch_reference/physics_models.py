"""The model (original: physics_models.py): encoder, velocity estimator, physics, decoder, losses."""
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import nn

from . import blocks
from .cells import CELLS
from .stn import stn
from .switches import Defects


class Encoder(blocks.Scope):
    """U-Net masks, then each masked object to its position."""

    def __init__(self, task, defects):
        super().__init__()
        self.task, self.defects = task, defects
        layers = blocks.unet_layers if task.deep else blocks.shallow_unet_layers
        self.convolutions = layers(self, task.objects)
        seen = task.side // 2 if task.deep else task.side
        self.denses = (self.new_dense(3 * seen * seen, 200), self.new_dense(200, 200), self.new_dense(200, 2))

    def forward(self, frames):
        """[B, 3, S, S] to positions [B, 2 N], masks [B, N + 1, S, S], masked frames [N, B, 3, S, S]."""
        n, half = self.task.objects, self.task.side / 2
        net = blocks.unet if self.task.deep else blocks.shallow_unet
        logits = net(self.convolutions, frames, self.defects.half_pixel, self.defects.relu_logits)
        logits = torch.cat([logits, torch.ones_like(logits[:, :1])], 1)
        masks = torch.softmax(logits, 1)
        masked = torch.stack([masks[:, i:i + 1] * frames for i in range(n)])
        h = masked.flatten(0, 1)
        if self.task.deep:
            h = F.avg_pool2d(h, 2)
        dense, dense_1, dense_2 = self.denses
        h = h.permute(0, 2, 3, 1).flatten(1)  # flattened in H, W, C order
        h = dense_2(F.relu(dense_1(F.relu(dense(h)))))
        pos = torch.tanh(h) * half + half
        return torch.cat(torch.chunk(pos, n, 0), 1), masks, masked


class VelocityEncoder(blocks.Scope):
    """Positions of the input frames to velocities, one object at a time."""

    def __init__(self, task):
        super().__init__()
        self.task = task
        sizes = [(2 * task.input_steps, 100), (100, 100), (100, 2)]
        if task.alt_vel:
            sizes = [(2 * (task.input_steps - 1), 2)]
        if task.input_steps == 1:
            sizes = []
        self.denses = [self.new_dense(*size) for size in sizes]

    def forward(self, pos):
        """[B, L, 2 N] to [B, 2 N]."""
        n = self.task.objects
        if self.task.input_steps == 1:
            return torch.zeros_like(pos[:, 0])
        if self.task.alt_vel:
            pos = pos[:, 1:] - pos[:, :-1]
        h = torch.cat(torch.chunk(pos, n, 2), 0).flatten(1)  # [N * B, 2 L]
        *hidden, output = self.denses
        for dense in hidden:
            h = torch.tanh(dense(h))
        return torch.cat(torch.chunk(output(h), n, 0), 1)


class Decoder(blocks.Scope):
    """Learned sprites moved to their positions and composed over a learned background."""

    def __init__(self, task, defects):
        super().__init__()
        self.task, self.defects, t = task, defects, task.side // 2
        self.logsigma = nn.Parameter(torch.zeros(()), requires_grad=not defects.fixed_sigma)
        self.template_net = blocks.VariableFromNetwork(self, [task.objects, t, t, 1])
        self.contents_net = blocks.VariableFromNetwork(self, [task.objects, t, t, 3])
        self.background_net = blocks.VariableFromNetwork(self, [1, task.side, task.side, 3])
        self.stn = stn

    def sprites(self):
        """Templates [N, 1, t, t], contents [N, 3, t, t] (before the sigmoid), background [1, 3, S, S] (after it)."""
        nets = (self.template_net, self.contents_net, self.background_net)
        template, contents, background = (net().permute(0, 3, 1, 2) for net in nets)
        return template, contents, torch.sigmoid(background)

    def forward(self, pos):
        """[B, 2 N] to frames [B, 3, S, S], masks [N + 1, B, 1, S, S], contents [N + 1, B, 3, S, S]."""
        s, t, batch = self.task.side, self.task.side // 2, pos.shape[0]
        template, contents, background = self.sprites()
        sigma = torch.exp(self.logsigma).expand(batch)
        zero = torch.zeros_like(sigma)
        logits, colours = [], []
        for i, object_pos in enumerate(torch.split(pos, 2, 1)):
            x, y = object_pos.unbind(1)
            theta = torch.stack([sigma, zero, (s / 2 - x) / t * sigma, zero, sigma, (s / 2 - y) / t * sigma], 1)
            sprite = torch.cat([template[i] + 5, torch.sigmoid(contents[i])]).expand(batch, -1, -1, -1)
            moved = self.stn(sprite, theta, s, self.defects.grid_sample)
            logits.append(moved[:, :1] - 5)
            colours.append(moved[:, 1:])
        masks = torch.softmax(torch.stack([*logits, torch.ones_like(logits[0])]), 0)
        colours = torch.stack([*colours, background.expand(batch, -1, -1, -1)])
        return torch.sum(masks * colours, 0), masks, colours


@dataclass
class Outputs:
    """One pass over clips; frames are [B, time, 3, S, S], positions [B, time, 2 N]."""
    enc_masks: torch.Tensor
    masked_objs: torch.Tensor
    enc_pos: torch.Tensor
    recons_out: torch.Tensor
    pos_vel_seq: torch.Tensor
    output: torch.Tensor
    last_masks: torch.Tensor
    last_contents: torch.Tensor
    recons_loss: torch.Tensor
    pred_loss: torch.Tensor
    extrap_loss: torch.Tensor
    train_loss: torch.Tensor


class PhysicsNet(nn.Module):
    def __init__(self, task, defects=Defects()):
        super().__init__()
        self.task, self.defects = task, defects
        self.encoder = Encoder(task, defects)
        self.decoder = Decoder(task, defects)
        self.init_vel = VelocityEncoder(task)
        self.add_module(task.cell, CELLS[task.cell](side=task.side, defects=defects))
        if defects.default_initial:
            self.apply(lambda m: m.reset_parameters() if isinstance(m, nn.Conv2d | nn.Linear) else None)

    def forward(self, clips):
        """Clips [B, T, S, S, 3] in [0, 1], channels last as they are stored."""
        task, defects = self.task, self.defects
        batch, time, s = clips.shape[0], clips.shape[1], task.side
        encoded = task.input_steps + task.pred_steps
        if defects.reshaped_frames:
            frames = clips.reshape(batch, time, 3, s, s)
        else:
            frames = clips.permute(0, 1, 4, 2, 3)

        # encoder -> decoder
        pos, masks, masked = self.encoder(frames[:, :encoded].flatten(0, 1))
        enc_pos = pos.reshape(batch, encoded, -1)
        recons_out = self.decoder(pos)[0].reshape(batch, encoded, 3, s, s)

        # velocity -> physics -> decoder
        vel = self.init_vel(enc_pos[:, :task.input_steps])
        pos = enc_pos[:, task.input_steps + 1 if defects.late_start else task.input_steps - 1]
        cell, states, positions = getattr(self, task.cell), [torch.cat([pos, vel], 1)], []
        for _ in range(task.input_steps, time):
            pos, vel = cell(pos, vel, task.dt)
            states.append(torch.cat([pos, vel], 1))
            positions.append(pos)
        output, out_masks, out_contents = self.decoder(torch.cat(positions))
        output = torch.stack(torch.chunk(output, len(positions)), 1)

        # losses
        future = frames[:, task.input_steps:]
        predicted = future[:, -task.pred_steps:] if defects.late_start else future[:, :task.pred_steps]
        recons_loss = frame_error(recons_out, frames[:, :encoded])
        pred_loss = frame_error(output[:, :task.pred_steps], predicted)
        extrap_loss = frame_error(output[:, task.pred_steps:], future[:, task.pred_steps:])
        return Outputs(
            enc_masks=masks, masked_objs=masked, enc_pos=enc_pos, recons_out=recons_out,
            pos_vel_seq=torch.stack(states, 1), output=output,
            last_masks=out_masks[:, -batch:], last_contents=out_contents[:, -batch:],
            recons_loss=recons_loss, pred_loss=pred_loss, extrap_loss=extrap_loss,
            train_loss=pred_loss + task.alpha * recons_loss)


def frame_error(x, y):
    """Squared error summed over a frame, averaged over batch and time."""
    return torch.mean(torch.sum((x - y) ** 2, (2, 3, 4)))

"""The reference written for speed, eager or compiled: python -m torch_reference.fast --task spring_color [--compile] [--tf32]

The computation and its numbers are those of physics_models.py. Channels stand last in memory, as oneDNN's convolutions
like it; all frames are decoded in one call; the spatial transformer is two matrix products for all objects at once;
masked frames are written in the order in which the dense layer reads them; the optimizer updates all parameters by
list operations. Compiled on a GPU, the loss is a CUDA graph (`reduce-overhead`), and --tf32 lets all its products round
their factors to ten bits, which PyTorch would otherwise do in the convolutions alone.
"""
import sys

import torch
import torch.nn.functional as F

from shared.speed import PREDICTED, main

from . import blocks
from .fit_speed import fit
from .physics_models import PhysicsNet
from .training.separable_stn import weights_of_source


class FastNet(PhysicsNet):
    def encode(self, frames):
        """Frames [F, 3, S, S], channels last in memory, to positions [F, 2 N]."""
        n, half = self.task.objects, self.task.side / 2
        unet = blocks.unet if self.task.deep else blocks.shallow_unet
        logits = unet(self.encoder.convolutions, frames)
        masks = torch.softmax(F.pad(logits.permute(0, 2, 3, 1), (0, 1), value=1.0), 3)
        masked = masks[..., :n].permute(3, 0, 1, 2)[..., None] * frames.permute(0, 2, 3, 1)
        h = masked.flatten(0, 1)
        if self.task.deep:
            h = F.avg_pool2d(h.permute(0, 3, 1, 2), 2).permute(0, 2, 3, 1)
        dense, dense_1, dense_2 = self.encoder.denses
        h = dense_2(F.relu(dense_1(F.relu(dense(h.flatten(1))))))
        return (torch.tanh(h) * half + half).reshape(n, -1, 2).transpose(0, 1).flatten(1)

    def decode(self, pos):
        """Positions [F, 2 N] to frames [F, 3, S, S]."""
        n, s, frames = self.task.objects, self.task.side, len(pos)
        t = s // 2
        template, contents, background = self.decoder.sprites()
        sigma = torch.exp(self.decoder.logsigma)
        shift = ((s / 2 - pos) / t * sigma).reshape(frames, n, 2).transpose(0, 1)
        line = torch.linspace(-1, 1, s, device=pos.device) * sigma
        columns, rows = (weights_of_source(shift[..., axis, None] + line, t) for axis in (0, 1))
        layers = torch.cat([template + 5, torch.sigmoid(contents)], 1).permute(0, 2, 1, 3).flatten(2)
        by_row = torch.bmm(rows.reshape(n, frames * s, t), layers).reshape(n * frames, s * 4, t)
        moved = torch.bmm(by_row, columns.reshape(n * frames, s, t).transpose(1, 2)).reshape(n, frames, s, 4, s)
        logits = moved[:, :, :, 0] - 5
        masks = torch.softmax(torch.cat([logits, torch.ones_like(logits[:1])]), 0)[:, :, :, None]
        drawn = (masks[:n] * moved[:, :, :, 1:]).sum(0) + masks[n] * background.permute(0, 2, 1, 3)
        return drawn.transpose(1, 2)

    def clips(self, clips):
        """Reconstructions and predictions of clips [B, T, 3, S, S]."""
        task, batch, time = self.task, clips.shape[0], clips.shape[1]
        encoded = task.input_steps + task.pred_steps
        frames = clips[:, :encoded].flatten(0, 1).contiguous(memory_format=torch.channels_last)
        enc_pos = self.encode(frames).reshape(batch, encoded, -1)
        vel = self.init_vel(enc_pos[:, :task.input_steps])
        pos, positions = enc_pos[:, task.input_steps - 1], []
        for _ in range(task.input_steps, time):
            pos, vel = getattr(self, task.cell)(pos, vel, task.dt)
            positions.append(pos)
        predicted = torch.stack(positions, 1)
        drawn = self.decode(torch.cat([enc_pos.flatten(0, 1), predicted.flatten(0, 1)]))
        split = batch * encoded
        return (part.reshape(batch, -1, *clips.shape[2:]) for part in (drawn[:split], drawn[split:]))

    def losses(self, clips):
        """L_rec, L_pred, and the predictions."""
        task = self.task
        recons, predictions = self.clips(clips)
        encoded, predicted = task.input_steps + task.pred_steps, predictions[:, :task.pred_steps]
        recons_loss = frame_error(recons, clips[:, :encoded])
        return recons_loss, frame_error(predicted, clips[:, task.input_steps:encoded]), predictions

    def step(self, clips):
        recons_loss, pred_loss, _ = self.losses(clips)
        return pred_loss + self.task.alpha * recons_loss

    def discover(self, frames):
        return frame_error(self.decode(self.encode(frames))[:, None], frames[:, None])

    def inference(self, clips):
        return tuple(self.clips(clips))

    def evaluation(self, clips):
        """L_rec, L_pred, L_extrap."""
        recons_loss, pred_loss, predictions = self.losses(clips)
        steps = self.task.pred_steps
        return recons_loss, pred_loss, frame_error(predictions[:, steps:], clips[:, self.task.input_steps + steps:])


def frame_error(x, y):
    return torch.sum((x - y) ** 2) / (x.shape[0] * x.shape[1])


class RMSProp:
    """TensorFlow 1's, on all parameters at once."""

    def __init__(self, parameters, lr):
        self.parameters, self.lr = list(parameters), lr
        self.ms = [torch.ones_like(p) for p in self.parameters]

    @torch.no_grad()
    def step(self):
        g = [p.grad for p in self.parameters]
        torch._foreach_clamp_min_(g, -1.0)
        torch._foreach_clamp_max_(g, 1.0)
        torch._foreach_mul_(self.ms, 0.9)
        torch._foreach_addcmul_(self.ms, g, g, 0.1)
        root = torch._foreach_add(self.ms, 1e-10)
        torch._foreach_sqrt_(root)
        torch._foreach_addcdiv_(self.parameters, g, root, -self.lr)
        for p in self.parameters:
            p.grad = None


def new(compiled):
    def repetition(what, task, batch, threads):
        torch.set_num_threads(threads)
        if what == "identify":
            return fit(task, batch)
        net = FastNet(task).to(memory_format=torch.channels_last)
        frames = {"step": task.seq_len, "discover": 1}.get(what, task.input_steps + PREDICTED)
        seen = torch.rand(batch, frames, 3, task.side, task.side)
        if what == "discover":
            seen = seen[:, 0].contiguous(memory_format=torch.channels_last)
        call = getattr(net, what)
        mode = "reduce-overhead" if torch.get_default_device().type == "cuda" else None
        call = torch.compile(call, dynamic=False, mode=mode) if compiled else call
        if what in ("inference", "evaluation"):
            return torch.no_grad()(lambda: call(seen))
        # The parameters that this loss has gradients for.
        call_once = getattr(net, what)(seen[:1])
        call_once.backward()
        rule = RMSProp([p for p in net.parameters() if p.grad is not None], task.base_lr)
        for p in net.parameters():
            p.grad = None

        def repeat():
            call(seen).backward()
            rule.step()

        return repeat

    return repetition


def to_device(device):
    torch.set_default_device(device)
    return torch.cuda.synchronize if torch.get_default_device().type == "cuda" else lambda: None


def taken(flag):
    """Whether the command line has this flag, which is taken from it."""
    given = flag in sys.argv
    sys.argv = [argument for argument in sys.argv if argument != flag]
    return given


if __name__ == "__main__":
    compiled = taken("--compile")
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = taken("--tf32")
    # The fit decides by numbers from step to step: there is nothing to compile.
    main(new(compiled), ("step", "discover", "inference", "evaluation", *(() if compiled else ("identify",))), to_device)

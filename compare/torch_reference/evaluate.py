"""Computes every tensor of a golden-format file with this reference, under the file's names and layouts."""
from dataclasses import replace

import numpy as np
import torch

from shared import tasks
from shared.given import as_stored
from shared.variable_names import layout_to_tensorflow, layout_to_torch, to_tensorflow, to_torch

from . import blocks
from .black_boxes import black_box_case, conv_lstm_case
from .cells import CELLS
from .optimizers import optimizer
from .physics_models import PhysicsNet
from .stn import stn
from .switches import Defects

CELL_TASKS = {"bouncing": "bouncing_balls", "spring": "spring_color", "gravity": "3bp_color"}


def evaluate(given, defects=Defects()):
    """{tensor name: array}; None for a file name without a case."""
    torch.set_num_threads(1)
    stem = given.stem
    for prefix, case in CASES.items():
        if stem.startswith(prefix):
            return case(given, stem.removeprefix(prefix), defects)
    return model_case(given, defects) if "meta" in given.arrays else None


def tensor(x, leaf=False):
    return torch.tensor(x, requires_grad=leaf)


def last(x):
    """Channels first to the files' channels last, as an array."""
    return array(x.movedim(-3, -1))


def first(x):
    return torch.movedim(x, -1, -3)


def array(x):
    return x.detach().numpy()


def load(module, weights, prefix="net/"):
    """Fills a module with weights by TensorFlow's names; strict."""
    state = {to_torch(prefix + name.removeprefix("net/")): layout_to_torch(x) for name, x in weights.items()}
    dtype = next(iter(weights.values())).dtype
    module.to(getattr(torch, str(dtype)))
    module.load_state_dict({name: torch.from_numpy(np.array(x)) for name, x in state.items()})


def original_layout(x):
    return layout_to_tensorflow(array(x))


def gradients(module, part=""):
    """{grad/<TensorFlow name>: as stored} of parameters whose name starts with `part`."""
    result = {}
    for name, p in module.named_parameters():
        if name.startswith(part):
            g = torch.zeros_like(p) if p.grad is None else p.grad
            result[f"grad/{to_tensorflow(name)}"] = as_stored(original_layout(g))
    return result


def resize_case(given, _, defects):
    x = tensor(given.input("in/x").astype("float32"))
    return {"out/y": last(blocks.resize_bilinear(first(x), defects.half_pixel))}


def stn_case(given, _, defects):
    images, theta = tensor(given.input("in/U"), leaf=True), tensor(given.input("in/theta"), leaf=True)
    weight = tensor(given.input("in/out_weight"))
    y = stn(first(images), theta, weight.shape[1], defects.grid_sample)
    torch.sum(y.movedim(1, 3) * weight).backward()
    return {"out/y": last(y), "grad/U": array(images.grad), "grad/theta": array(theta.grad)}


class UNet(torch.nn.Module):
    """A U-Net by itself, under the scope `unet`."""

    def __init__(self, deep, objects, defects):
        super().__init__()
        self.unet, self.deep, self.defects = blocks.Scope(), deep, defects
        self.convolutions = (blocks.unet_layers if deep else blocks.shallow_unet_layers)(self.unet, objects)

    def forward(self, x):
        net = blocks.unet if self.deep else blocks.shallow_unet
        return net(self.convolutions, x, self.defects.half_pixel, self.defects.relu_logits)


def unet_case(given, _, defects):
    weight = tensor(given.input("in/out_weight"))
    net = UNet(given.stem.startswith("unet"), weight.shape[3], defects)
    load(net, given.weights())
    y = net(first(tensor(given.input("in/x"))))
    torch.sum(y.movedim(1, 3) * weight).backward()
    return {"out/y": last(y)} | {name.replace("net/", "", 1): g for name, g in gradients(net).items()}


def cell_case(given, rest, defects):
    task = tasks.TASKS[CELL_TASKS[rest.split("_")[0]]]
    cell = CELLS[task.cell](side=task.side, defects=defects)
    parameters = dict(cell.named_parameters())
    for name, p in parameters.items():
        p.data = tensor(given.input(f"param/{name}"))
    if "param/log_m" in given.arrays:
        cell.log_m = tensor(given.input("param/log_m"))
    pos0, vel0 = tensor(given.input("in/pos"), leaf=True), tensor(given.input("in/vel"), leaf=True)
    weight = tensor(given.input("in/pos_weight"))
    pos, vel, positions, velocities = pos0, vel0, [], []
    for _ in range(weight.shape[0]):
        pos, vel = cell(pos, vel, task.dt)
        positions.append(pos)
        velocities.append(vel)
    positions, velocities = torch.stack(positions), torch.stack(velocities)
    loss = 1e-3 * torch.sum(positions * weight)
    loss.backward()
    result = {"out/pos": array(positions), "out/vel": array(velocities), "out/loss": array(loss),
              "grad/pos": array(pos0.grad), "grad/vel": array(vel0.grad)}
    for name, p in parameters.items():
        result[f"grad/{name}"] = array(torch.zeros_like(p) if p.grad is None else p.grad)
    return result


def decoder_case(given, rest, defects):
    task = tasks.of_stem(rest)
    net = PhysicsNet(task, defects)
    load(net, given.weights())
    pos = tensor(given.input("in/pos"), leaf=True)
    frames, masks, _ = net.decoder(pos)
    y = frames.movedim(1, 3)
    torch.sum(y * tensor(given.out_weight(y.shape))).backward()
    result = {"out/y": array(y), "grad/pos": array(pos.grad)} | gradients(net, "decoder.")
    if task.side < 64:
        result["out/masks"] = array(masks[:, :, 0])
    return result


def encoder_case(given, rest, defects):
    net = PhysicsNet(tasks.of_stem(rest), defects)
    load(net, given.weights())
    pos, masks, masked = net.encoder(first(tensor(given.input("in/x"))))
    torch.sum(pos * tensor(given.input("in/pos_weight"))).backward()
    return {"out/pos": array(pos), "out/masks": last(masks), "out/masked_objs": last(masked)} | gradients(
        net, "encoder.")


def velocity_case(given, rest, defects):
    alt_vel = rest.startswith("alt_")
    task = tasks.of_stem(rest.removeprefix("alt_"))
    net = PhysicsNet(replace(task, alt_vel=alt_vel), defects)
    load(net, given.weights())
    pos = tensor(given.input("in/pos"), leaf=True)
    vel = net.init_vel(pos)
    torch.sum(vel * tensor(given.input("in/vel_weight"))).backward()
    return {"out/vel": array(vel), "grad/pos": array(pos.grad)} | gradients(net, "init_vel.")


def variable_case(given, rest, defects):
    net = PhysicsNet(tasks.of_stem(rest), defects)
    load(net, given.weights())
    template, contents, background = net.decoder.sprites()
    flat = torch.cat([x.movedim(1, 3).flatten() for x in (template, contents, background)])
    torch.sum(flat * tensor(given.out_weight(flat.shape))).backward()
    return {"out/template": last(template), "out/contents": last(contents),
            "out/background_content": last(background)} | gradients(net, "decoder.dense")


CASES = {"black_box_": black_box_case, "conv_lstm": conv_lstm_case, "resize_bilinear": resize_case, "stn": stn_case, "shallow_unet": unet_case, "unet": unet_case,
         "cell_": cell_case, "decoder_": decoder_case, "encoder_": encoder_case, "init_vel_": velocity_case,
         "variable_from_network_": variable_case}


def model_case(given, defects):
    task, _, _ = given.meta()
    net = PhysicsNet(task, defects)
    load(net, given.weights())
    clips = given.clips()
    result = {"in/head": clips.reshape(-1)[:4096:7], "in/sum": np.float64(clips.sum(dtype=np.float64))}
    names = [name for name in given.arrays if name.startswith("w/")]
    weights = given.exact_weights()
    result |= {name: weights[name.removeprefix("w/")].reshape(-1)[:64] for name in names}

    clips = tensor(clips)
    out = net(clips)
    template, contents, background = net.decoder.sprites()
    for name in ("enc_masks", "masked_objs", "recons_out", "output", "last_contents"):
        result[f"out/{name}"] = last(getattr(out, name))
    for name in ("enc_pos", "pos_vel_seq", "recons_loss", "pred_loss", "extrap_loss", "train_loss"):
        result[f"out/{name}"] = array(getattr(out, name))
    result |= {"out/last_masks": last(out.last_masks.expand(-1, -1, 3, -1, -1)), "out/template": last(template),
               "out/contents": last(contents), "out/background_content": last(background)}
    out.train_loss.backward()
    result |= gradients(net)
    for name, p in net.named_parameters():
        norm = 0.0 if p.grad is None else torch.linalg.vector_norm(p.grad)
        result[f"gradnorm/{to_tensorflow(name)}"] = np.asarray(norm, given.dtype)

    steps = given.arrays["train/loss_before_each_step"].size
    rule = optimizer(task, net.parameters(), defects)
    losses = [out.train_loss.item()]
    for _ in range(steps - 1):
        rule.step()
        loss = net(clips).train_loss
        loss.backward()
        losses.append(loss.item())
    rule.step()
    result["train/loss_before_each_step"] = np.array(losses, given.dtype)
    for name, p in net.named_parameters():
        result[f"train/var_after/{to_tensorflow(name)}"] = as_stored(original_layout(p))
    return result

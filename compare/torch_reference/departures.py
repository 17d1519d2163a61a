"""The first tensor that departs from the golden with a known defect, and by how much.

Tensors are looked at in the order in which the data flow. Two defects need more than a golden file holds: initial
values (4) are compared with Glorot's bound, and the annealed rate (7) with this reference without the defect.
"""
import numpy as np
import torch

from shared.checks import errors, load
from shared.given import Given
from shared.tasks import TASKS

from .evaluate import evaluate
from .evaluate import load as load_weights
from .optimizers import optimizer
from .physics_models import PhysicsNet
from .switches import Defects

FLOW = ("out/y", "out/enc_masks", "out/masked_objs", "out/enc_pos", "out/recons_out", "out/pos_vel_seq", "out/output",
        "out/recons_loss", "out/pred_loss", "out/extrap_loss", "out/train_loss", "grad/net/decoder", "grad",
        "train/loss_before_each_step", "train")
# A tensor departs beyond this; the correct reference stays well below it in these files.
DEPARTS = 2e-3
DEFAULT_FILE, THREE_BODIES = "spring_color_spread_train", "3bp_color_spread_train"


def first_departure(given, arrays, defects):
    """(tensor, error relative to its largest element) of the first tensor that departs."""
    computed = evaluate(given, defects)
    for part in FLOW:
        for name in sorted(computed):
            if name == part or name.startswith(part + "/"):
                error = float(errors(arrays[name], computed[name]).max())
                if not error <= DEPARTS:
                    return name, error
    return "none", 0.0


def initial_values(defects):
    """Largest bias, where the original's are zero, and first kernel over Glorot's bound."""
    torch.manual_seed(0)
    layer = PhysicsNet(TASKS["spring_color"], defects).encoder.conv2d
    kernel, bias = layer.weight.abs().max() / (6 / (9 * (3 + 8))) ** 0.5, layer.bias.abs().max()
    return f"kernel up to {kernel:.2f} of Glorot's bound, bias up to {bias:.2f}"


def annealing(given, defects):
    """How far a variable's second step, the first after annealing, departs from the one without the defect."""
    task, steps = given.meta()[0], []
    for each in (Defects(), defects):
        net = PhysicsNet(task, each)
        load_weights(net, given.weights())
        rule = optimizer(task, net.parameters(), each)
        for _ in range(2):
            before = net.decoder.logsigma.item()
            net(torch.tensor(given.clips())).train_loss.backward()
            rule.step()
            rule.anneal()
        steps.append(net.decoder.logsigma.item() - before)
    return f"a step {steps[1] / steps[0]:.2f} times as long"


def departure(number, goldens):
    """(tensor, by how much) in words."""
    defects = Defects.number(number)
    stem = THREE_BODIES if defects.strength_once else DEFAULT_FILE
    arrays = load(goldens / f"{stem}.npz")
    if defects.default_initial:
        return "initial values", initial_values(defects)
    if defects.no_annealing:
        return "a variable after an annealed step", annealing(Given(stem, arrays), defects)
    name, error = first_departure(Given(stem, arrays), arrays, defects)
    return f"`{name}`", f"{error:.1e}" if np.isfinite(error) else "not a number"

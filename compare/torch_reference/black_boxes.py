"""The networks that the physics is compared with: python -m torch_reference.black_boxes goldens

Makes their golden files: the original has no such networks, so PyTorch's own cells are what the port is held to.
"""
import argparse
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

SIDES = {"spring_color": 32, "3bp_color": 36}
OBJECTS = {"spring_color": 2, "3bp_color": 3}
INPUT, FRAMES, BATCH = 4, 6, 8
LSTM, GRU, MLP, HIDDEN, EFFECT = 100, 115, 195, 100, 50


def dense(p, name, x):
    return functional.linear(x, p[f"dynamics.{name}.weight"], p[f"dynamics.{name}.bias"])


def lstm(p, positions, frames):
    """`torch.nn.LSTMCell`; its forget gate's bias is one larger, and one of its two biases is zero."""
    n = positions.shape[2]
    cell = torch.nn.LSTMCell(n, LSTM).to(positions.dtype)
    weight, bias = p["dynamics.dense.weight"], p["dynamics.dense.bias"]
    forget = torch.zeros_like(bias)
    forget[LSTM:2 * LSTM] = 1
    values = {"weight_ih": weight[:, :n], "weight_hh": weight[:, n:], "bias_ih": bias + forget,
              "bias_hh": torch.zeros_like(bias)}

    def see(memory, x):
        return torch.func.functional_call(cell, values, (x, memory))

    return roll(positions, frames, see, lambda memory: dense(p, "dense_1", memory[0]))


def gru(p, positions, frames):
    """`torch.nn.GRUCell`."""
    cell = torch.nn.GRUCell(positions.shape[2], GRU).to(positions.dtype)
    values = {"weight_ih": p["dynamics.dense.weight"], "bias_ih": p["dynamics.dense.bias"],
              "weight_hh": p["dynamics.dense_1.weight"], "bias_hh": p["dynamics.dense_1.bias"]}

    def see(memory, x):
        return torch.func.functional_call(cell, values, (x, memory))

    return roll(positions, frames, see, lambda memory: dense(p, "dense_2", memory))


def layers(p, names, x):
    for name in names[:-1]:
        x = torch.relu(dense(p, name, x))
    return dense(p, names[-1], x)


def keep_last(memory, x):
    return ((memory or []) + [x])[-INPUT:]


def interaction_network(p, positions, frames):
    objects = positions.shape[2] // 2

    def change(memory):
        o = [torch.cat([x[:, 2 * i:2 * i + 2] for x in memory], 1) for i in range(objects)]
        changes = []
        for i in range(objects):
            effect = torch.zeros(len(o[i]), EFFECT, dtype=positions.dtype)
            for j in range(objects):
                if i != j:
                    names = ["dense", "dense_1", "dense_2", "dense_3"]
                    effect = effect + layers(p, names, torch.cat([o[i], o[j]], 1))
            changes.append(layers(p, ["dense_4", "dense_5", "dense_6"], torch.cat([o[i], effect], 1)))
        return torch.cat(changes, 1)

    return roll(positions, frames, keep_last, change)


def mlp(p, positions, frames):
    return roll(positions, frames, keep_last,
                lambda memory: layers(p, ["dense", "dense_1", "dense_2"], torch.cat(memory, 1)))


def linear(p, positions, frames):
    return roll(positions, frames, keep_last, lambda memory: dense(p, "dense", torch.cat(memory, 1)))


def roll(positions, frames, see, change):
    """Positions in -1..1 are seen one frame after the other; what follows is the last position and the changes."""
    half = roll.side / 2
    memory = None
    for frame in range(positions.shape[1]):
        memory = see(memory, positions[:, frame] / half - 1)
    last, rolled = positions[:, -1], []
    for _ in range(frames):
        last = last + half * change(memory)
        memory = see(memory, last / half - 1)
        rolled.append(last)
    return torch.stack(rolled, 1)


NETWORKS = {"lstm": lstm, "gru": gru, "interaction_network": interaction_network, "mlp": mlp, "linear": linear}


def shapes(kind, n):
    """[out, in] of each dense layer."""
    pairs = 2 * 2 * INPUT
    return {"lstm": [(4 * LSTM, n + LSTM), (n, LSTM)],
            "gru": [(3 * GRU, n), (3 * GRU, GRU), (n, GRU)],
            "interaction_network": [(HIDDEN, pairs), (HIDDEN, HIDDEN), (HIDDEN, HIDDEN), (EFFECT, HIDDEN),
                                    (HIDDEN, pairs // 2 + EFFECT), (HIDDEN, HIDDEN), (2, HIDDEN)],
            "mlp": [(MLP, INPUT * n), (MLP, MLP), (n, MLP)],
            "linear": [(n, INPUT * n)]}[kind]


def of_stem(stem):
    rest = stem.removeprefix("black_box_")
    kind = next(kind for kind in NETWORKS if rest.startswith(f"{kind}_"))
    return kind, next(task for task in SIDES if rest.removeprefix(f"{kind}_").startswith(task))


def leaf(x):
    return torch.tensor(x, requires_grad=True)


def results(p, x, name, y, weight):
    torch.sum(y * weight).backward()
    out = {f"out/{name}": y.detach().numpy(), **{f"grad/{key}": value.grad.numpy() for key, value in p.items()}}
    return out | {"grad/" + ("pos" if name == "pos" else "x"): x.grad.numpy()}


def parameters(given):
    names = [name.removeprefix("param/") for name in given.arrays if name.startswith("param/")]
    return {name: leaf(given.input(f"param/{name}")) for name in names}


def black_box_case(given, _, __):
    kind, task = of_stem(given.stem)
    p, pos = parameters(given), leaf(given.input("in/pos"))
    weight = torch.tensor(given.input("in/pos_weight"))
    roll.side = SIDES[task]
    return results(p, pos, "pos", NETWORKS[kind](p, pos, weight.shape[1]), weight)


def conv_lstm_case(given, _, __):
    p, x = parameters(given), leaf(given.input("in/x"))
    hidden = p["conv2d.weight"].shape[0] // 4
    size = p["conv2d.weight"].shape[2]
    h = torch.zeros(len(x), hidden, *x.shape[3:], dtype=x.dtype)
    c, memories = torch.zeros_like(h), []
    for frame in x.unbind(1):
        gates = functional.conv2d(torch.cat([frame, h], 1), p["conv2d.weight"], p["conv2d.bias"], padding=size // 2)
        i, f, g, o = gates.split(hidden, 1)
        c = torch.sigmoid(f + 1) * c + torch.sigmoid(i) * torch.tanh(g)
        h = torch.sigmoid(o) * torch.tanh(c)
        memories.append(h)
    return results(p, x, "h", torch.stack(memories, 1), torch.tensor(given.input("in/h_weight")))


class Drawn:
    """Fresh inputs in the place of a golden file."""

    def __init__(self, stem, arrays):
        self.stem, self.arrays = stem, {name: np.asarray(x, "float32") for name, x in arrays.items()}

    def input(self, name):
        return self.arrays[name]


def drawn(random):
    """{file name: inputs}; kernels as Glorot's, biases small."""
    def layer(name, out, inputs, *size):
        limit = np.sqrt(6 / ((out + inputs) * np.prod(size, initial=1)))
        return {f"param/{name}.weight": random.uniform(-limit, limit, (out, inputs, *size)),
                f"param/{name}.bias": random.uniform(-0.1, 0.1, out)}

    for kind, task in [*((kind, "spring_color") for kind in NETWORKS), ("interaction_network", "3bp_color")]:
        n = 2 * OBJECTS[task]
        arrays = {"in/pos": random.uniform(4, SIDES[task] - 4, (BATCH, INPUT, n)),
                  "in/pos_weight": random.standard_normal((BATCH, FRAMES, n))}
        for place, shape in enumerate(shapes(kind, n)):
            arrays |= layer("dynamics.dense" + (f"_{place}" if place else ""), *shape)
        yield f"black_box_{kind}_{task}", black_box_case, arrays
    arrays = {"in/x": random.uniform(0, 1, (2, 5, 3, 9, 9)), "in/h_weight": random.standard_normal((2, 5, 4, 9, 9))}
    yield "conv_lstm", conv_lstm_case, arrays | layer("conv2d", 16, 7, 3, 3)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Makes the goldens of networks that the original lacks.")
    parser.add_argument("goldens", type=Path)
    folder = parser.parse_args().goldens
    if not folder.is_dir():
        parser.error(f"{folder}: no such folder")
    torch.set_num_threads(1)
    for stem, case, arrays in drawn(np.random.default_rng(0)):
        given = Drawn(stem, arrays)
        np.savez_compressed(folder / f"{stem}.npz", **given.arrays, **case(given, None, None))
        print(stem)

"""What a golden-format file gives a computation: inputs, weights, the task. See ../goldens/README.md."""
from dataclasses import replace

import numpy as np

from . import formula, tasks


class Given:
    """`dtype`: the precision to compute in; `roundings`: move every input at random by up to so many of float32's."""

    def __init__(self, stem, arrays, dtype="float32", roundings=0, seed=0):
        self.stem, self.arrays, self.dtype = stem, arrays, dtype
        self.step, self.random = roundings * np.finfo(np.float32).eps, np.random.default_rng(seed)

    def taken_in(self, x):
        x = np.asarray(x)
        if self.step:
            x = x * (1 + self.random.uniform(-self.step, self.step, x.shape))
        return np.asarray(x, self.dtype)

    def input(self, name):
        return self.taken_in(self.arrays[name])

    def seed(self, name):
        return int(self.arrays[name])

    def out_weight(self, shape):
        """Weights of the loss sum(y * w): stored, or by formula from `out_weight_seed`."""
        stored = self.arrays.get("in/out_weight")
        return self.taken_in(formula.signed(self.seed("out_weight_seed"), shape) if stored is None else stored)

    def meta(self):
        """(task with the file's own numbers, batch, weight seed) of a whole-model file."""
        meta = dict(pair.split("=") for pair in str(self.arrays["meta"][0]).split())
        task = replace(
            tasks.TASKS[meta["task"]], side=int(meta["size"]), seq_len=int(meta["seq_len"]),
            input_steps=int(meta["input_steps"]), pred_steps=int(meta["pred_steps"]), base_lr=float(meta["lr"]),
            alpha=float(meta["ae"]), alt_vel=meta["alt_vel"] == "True", opt=meta["opt"])
        return task, int(meta["batch"]), int(meta["seed"])

    def exact_weights(self):
        """All variables of the file by TensorFlow's names, in the file's order, float32."""
        suffix = "_all" if "var_names_all" in self.arrays else ""
        names, shapes = self.arrays["var_names" + suffix], self.arrays["var_shapes" + suffix]
        weight_seed = self.seed("weight_seed") if "weight_seed" in self.arrays else self.meta()[2]
        default = {"log_k": 0.0, "log_l": 0.0, "log_g": 0.0, "logsigma": np.log(1.3)}
        scalars = self.assignments("scalars") if "scalars" in self.arrays else default
        factors = self.assignments("scale") if "scale" in self.arrays else {}
        weights = {}
        for index, (name, shape) in enumerate(zip(names, shapes)):
            name, shape = str(name), tuple(int(n) for n in str(shape).split(",") if n)
            if shape:
                weights[name] = formula.weight(weight_seed, index, shape, factors.get(name, 1.0))
            else:
                weights[name] = np.float32(scalars[name.split("/")[-1]])
        return weights

    def weights(self):
        return {name: self.taken_in(x) for name, x in self.exact_weights().items()}

    def clips(self):
        task, batch, weight_seed = self.meta()
        return self.taken_in(formula.clips(weight_seed, batch, task.seq_len, task.side))

    def assignments(self, name):
        return {key: float(value) for key, value in (str(pair).split("=") for pair in self.arrays[name])}


def as_stored(x):
    """Gradients and trained variables are stored flattened, of large ones every 97th element."""
    flat = np.asarray(x).reshape(-1)
    return flat[::97] if flat.size > 4096 else flat

"""Fresh inputs of the cases, in the golden files' format. `random` is a NumPy generator of the case's own."""
from dataclasses import replace

import numpy as np

from .model_variables import listing, model_variables, unet_variables
from .tasks import TASKS

STEPS, BATCH = 5, 2
# As in the goldens' spread files: positions spread over the frame, so that bodies do not coincide.
SPREAD = {"dense/kernel": 4.0, "dense_2/kernel": 6.0}


def weight_seed(random):
    return int(random.integers(1, 1_000_000))


def normal(random, *shape):
    return random.standard_normal(shape).astype(np.float32)


def unit(random, *shape):
    return random.uniform(0, 1, shape).astype(np.float32)


def unet(random, key):
    task = TASKS[key]
    names, shapes = listing(unet_variables("unet", task))
    s = task.side
    return {"in/x": unit(random, BATCH, s, s, 3), "in/out_weight": normal(random, BATCH, s, s, task.objects),
            "var_names": names, "var_shapes": shapes, "weight_seed": np.int64(weight_seed(random))}


def cell(random, key, speed, radius=(0.2, 0.35), **parameters):
    """Bodies on a circle whose radius is a share of a frame's side: by default well apart, so that nothing is chaotic in the first
    frames."""
    task, batch, frames = TASKS[key], 16, 10
    n, s = task.objects, task.side
    angle = random.uniform(0, 2 * np.pi, (batch, 1)) + np.arange(n) * 2 * np.pi / n
    radius = random.uniform(*radius, (batch, 1)) * s
    pos = s / 2 + np.stack([radius * np.cos(angle), radius * np.sin(angle)], 2).reshape(batch, 2 * n)
    return {"in/pos": pos.astype(np.float32), "in/vel": speed * normal(random, batch, 2 * n),
            "in/pos_weight": normal(random, frames, batch, 2 * n),
            **{f"param/{name}": np.float32(value) for name, value in parameters.items()}}


def part(random, key, alt_vel=False, **arrays):
    """A part of a model: the whole model's variables, and the part's own arrays."""
    names, shapes = listing(model_variables(replace(TASKS[key], alt_vel=alt_vel)))
    return {"var_names_all": names, "var_shapes_all": shapes, "weight_seed": np.int64(weight_seed(random)), **arrays}


def model(random, key, opt="rmsprop", alt_vel=False):
    task = replace(TASKS[key], alt_vel=alt_vel)
    names, shapes = listing(model_variables(task))
    last_logits = f"conv2d_{17 if task.deep else 12}/kernel"
    scale = {"net/encoder/" + name: factor for name, factor in {last_logits: 40.0, **SPREAD}.items()}
    scalars = {"log_k": random.uniform(-1, 1.5), "log_l": random.uniform(0, 1.5), "log_g": random.uniform(0, 3),
               "logsigma": random.uniform(-0.2, 0.4)}
    meta = (f"task={key} seed={weight_seed(random)} batch={BATCH} alt_vel={alt_vel} ae={task.alpha} opt={opt} "
            f"lr={task.base_lr} seq_len={task.seq_len} input_steps={task.input_steps} pred_steps={task.pred_steps} "
            f"size={task.side}")
    return {"meta": np.array([meta]), "var_names": names, "var_shapes": shapes,
            "scalars": np.array([f"{name}={float(value)!r}" for name, value in scalars.items()]),
            "scale": np.array([f"{name}={value}" for name, value in scale.items()]),
            # To be filled; their sizes and names say what is asked for.
            "train/loss_before_each_step": np.zeros(STEPS), **{f"w/{name}": np.zeros(0) for name in names}}

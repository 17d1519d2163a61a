"""Names and shapes of a model's variables in TensorFlow's layout, in the order in which the original makes them."""

import numpy as np


def unet(task):
    """(inputs, outputs) of the 3x3 convolutions, then of the last 1x1."""
    poolings, b = (3, 16) if task.deep else (2, 8)
    widths = [b << level for level in range(poolings + 1)]
    sizes = [pair for i, w in enumerate(widths) for pair in ((widths[i - 1] if i else 3, w), (w, w))]
    below = widths[-1]
    for w in reversed(widths[:-1]):
        sizes += [(below, 2 * b), (2 * b + w, w), (w, w)]
        below = w
    return sizes, (b, task.objects)


def layers(scope, kind, shapes):
    for index, shape in enumerate(shapes):
        name = f"{scope}/{kind}" + (f"_{index}" if index else "")
        yield f"{name}/kernel", shape
        yield f"{name}/bias", shape[-1:]


def unet_variables(scope, task):
    convolutions, last = unet(task)
    return dict(layers(scope, "conv2d", [(3, 3, *size) for size in convolutions] + [(1, 1, *last)]))


def model_variables(task):
    s, n, t = task.side, task.objects, task.side // 2
    seen = t if task.deep else s
    variables = unet_variables("net/encoder", task)
    variables |= layers("net/encoder", "dense", [(3 * seen * seen, 200), (200, 200), (200, 2)])
    variables["net/decoder/logsigma"] = ()
    outputs = [n * t * t, 3 * n * t * t, 3 * s * s]
    variables |= layers("net/decoder", "dense", [shape for out in outputs for shape in ((10, 200), (200, out))])
    l = task.input_steps
    velocity = [(2 * (l - 1), 2)] if task.alt_vel else [(2 * l, 100), (100, 100), (100, 2)]
    variables |= layers("net/init_vel", "dense", velocity if l > 1 else [])
    scalars = {"spring_ode_cell": ["log_k", "log_l"], "gravity_ode_cell": ["log_g"], "bouncing_ode_cell": []}
    return variables | {f"net/{task.cell}/{name}": () for name in scalars[task.cell]}


def listing(variables):
    """The texts by which a golden-format file names its variables and their shapes."""
    return np.array(list(variables)), np.array([",".join(map(str, shape)) for shape in variables.values()])

"""Computes every tensor of a golden-format file with this reference, under the file's names and layouts."""
from dataclasses import replace

import numpy as np
import tensorflow as tf

from shared import tasks
from shared.given import as_stored

from . import blocks, physics_models
from .cells import CELLS
from .optimizers import optimizer, step
from .stn import stn

CELL_TASKS = {"bouncing": "bouncing_balls", "spring": "spring_color", "gravity": "3bp_color"}
tf.config.threading.set_intra_op_parallelism_threads(1)
tf.config.threading.set_inter_op_parallelism_threads(1)


def evaluate(given):
    """{tensor name: array}; None for a file name without a case."""
    stem = given.stem
    for prefix, case in CASES.items():
        if stem.startswith(prefix):
            return case(given, stem.removeprefix(prefix))
    return model_case(given) if "meta" in given.arrays else None


def variables_of(given, prefix=""):
    return blocks.Variables({prefix + name: x for name, x in given.weights().items()}, given.dtype)


def gradients(tape, loss, variables, part=""):
    """{grad/<name>: as stored} of variables whose name starts with `part`."""
    names = [name for name in variables if name.startswith(part)]
    found = tape.gradient(loss, [variables[name] for name in names], unconnected_gradients="zero")
    return {f"grad/{name}": as_stored(g) for name, g in zip(names, found)}


def arrays(**tensors):
    return {f"out/{name}": x.numpy() for name, x in tensors.items()}


def resize_case(given, _):
    # In single precision always: that is TensorFlow's own operation.
    return arrays(y=blocks.resize_bilinear(tf.constant(given.input("in/x"), tf.float32)))


def stn_case(given, _):
    images, theta = tf.Variable(given.input("in/U")), tf.Variable(given.input("in/theta"))
    weight = given.input("in/out_weight")
    with tf.GradientTape() as tape:
        y = stn(images.read_value(), theta.read_value(), weight.shape[1])
        loss = tf.reduce_sum(y * weight)
    by_images, by_theta = tape.gradient(loss, [images, theta])
    return arrays(y=y) | {"grad/U": tf.convert_to_tensor(by_images).numpy(), "grad/theta": by_theta.numpy()}


def unet_case(given, _):
    weight = given.input("in/out_weight")
    net = blocks.unet if given.stem.startswith("unet") else blocks.shallow_unet
    variables = variables_of(given)
    with tf.GradientTape(persistent=True) as tape:
        y = net(blocks.Scope(variables, "unet"), tf.constant(given.input("in/x")), weight.shape[3])
        loss = tf.reduce_sum(y * weight)
    return arrays(y=y) | gradients(tape, loss, variables)


def cell_case(given, rest):
    task = tasks.TASKS[CELL_TASKS[rest.split("_")[0]]]
    parameters = {name: given.input(f"param/{name}") for name in ("log_k", "log_l", "log_g")
                  if f"param/{name}" in given.arrays}
    variables = blocks.Variables({f"cell/{name}": x for name, x in parameters.items()}, given.dtype)
    options = {"log_m": given.input("param/log_m")} if "param/log_m" in given.arrays else {}
    scope, weight = blocks.Scope(variables, "cell"), given.input("in/pos_weight")
    pos0, vel0 = tf.Variable(given.input("in/pos")), tf.Variable(given.input("in/vel"))
    with tf.GradientTape(persistent=True) as tape:
        pos, vel, positions, velocities = pos0 + 0, vel0 + 0, [], []
        for _ in range(len(weight)):
            pos, vel = CELLS[task.cell](scope, pos, vel, task.dt, side=task.side, **options)
            positions.append(pos)
            velocities.append(vel)
        positions, velocities = tf.stack(positions), tf.stack(velocities)
        loss = 1e-3 * tf.reduce_sum(positions * weight)
    result = arrays(pos=positions, vel=velocities, loss=loss)
    for name, x in {"pos": pos0, "vel": vel0, **{n.split("/")[1]: v for n, v in variables.items()}}.items():
        result[f"grad/{name}"] = tape.gradient(loss, x).numpy()
    return result


def decoder_case(given, rest):
    task, variables, pos = tasks.of_stem(rest), variables_of(given), tf.Variable(given.input("in/pos"))
    with tf.GradientTape(persistent=True) as tape:
        y, masks, _, _ = physics_models.decoder(variables, task, pos + 0)
        loss = tf.reduce_sum(y * given.out_weight(y.shape))
    result = arrays(y=y) | {"grad/pos": tape.gradient(loss, pos).numpy()}
    result |= gradients(tape, loss, variables, "net/decoder/")
    return result | (arrays(masks=masks[..., 0]) if task.side < 64 else {})


def encoder_case(given, rest):
    task, variables = tasks.of_stem(rest), variables_of(given)
    with tf.GradientTape(persistent=True) as tape:
        pos, masks, masked = physics_models.encoder(variables, task, tf.constant(given.input("in/x")))
        loss = tf.reduce_sum(pos * given.input("in/pos_weight"))
    return arrays(pos=pos, masks=masks, masked_objs=masked) | gradients(tape, loss, variables, "net/encoder/")


def velocity_case(given, rest):
    task = replace(tasks.of_stem(rest.removeprefix("alt_")), alt_vel=rest.startswith("alt_"))
    variables, pos = variables_of(given), tf.Variable(given.input("in/pos"))
    with tf.GradientTape(persistent=True) as tape:
        vel = physics_models.vel_encoder(variables, task, pos + 0)
        loss = tf.reduce_sum(vel * given.input("in/vel_weight"))
    return arrays(vel=vel) | {"grad/pos": tape.gradient(loss, pos).numpy()} | gradients(
        tape, loss, variables, "net/init_vel/")


def variable_case(given, rest):
    task, variables = tasks.of_stem(rest), variables_of(given)
    with tf.GradientTape(persistent=True) as tape:
        values = physics_models.sprites(blocks.Scope(variables, "net/decoder"), task)
        flat = tf.concat([tf.reshape(x, [-1]) for x in values], 0)
        loss = tf.reduce_sum(flat * given.out_weight(flat.shape))
    return arrays(**dict(zip(("template", "contents", "background_content"), values))) | gradients(
        tape, loss, variables, "net/decoder/dense")


CASES = {"resize_bilinear": resize_case, "stn": stn_case, "shallow_unet": unet_case, "unet": unet_case,
         "cell_": cell_case, "decoder_": decoder_case, "encoder_": encoder_case, "init_vel_": velocity_case,
         "variable_from_network_": variable_case}


def model_case(given):
    task, _, _ = given.meta()
    variables, clips = variables_of(given), given.clips()
    result = {"in/head": clips.reshape(-1)[:4096:7], "in/sum": np.float64(clips.sum(dtype=np.float64))}
    weights = given.exact_weights()
    names = [name for name in given.arrays if name.startswith("w/")]
    result |= {name: weights[name.removeprefix("w/")].reshape(-1)[:64] for name in names}

    clips = tf.constant(clips)
    rule, losses = optimizer(task, given.dtype), []
    for number in range(given.arrays["train/loss_before_each_step"].size):
        with tf.GradientTape() as tape:
            out = physics_models.physics_net(variables, task, clips)
        found = tape.gradient(out.train_loss, list(variables.values()))
        if number == 0:
            result |= arrays(**vars(out))
            for (name, variable), g in zip(variables.items(), found):
                g = tf.zeros_like(variable) if g is None else g
                result |= {f"grad/{name}": as_stored(g), f"gradnorm/{name}": tf.norm(g).numpy()}
        losses.append(out.train_loss.numpy())
        step(rule, found, variables.values())
    result["train/loss_before_each_step"] = np.array(losses)
    return result | {f"train/var_after/{name}": as_stored(v) for name, v in variables.items()}

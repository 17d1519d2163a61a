"""The model (original: physics_models.py): encoder, velocity estimator, physics, decoder, losses."""
from types import SimpleNamespace

import tensorflow as tf

from . import blocks
from .cells import CELLS
from .stn import stn


def encoder(variables, task, frames):
    """Frames [B, S, S, 3] to positions [B, 2 N], masks [B, S, S, N + 1], masked frames [N, B, S, S, 3]."""
    scope, n, half = blocks.Scope(variables, "net/encoder"), task.objects, task.side / 2
    logits = (blocks.unet if task.deep else blocks.shallow_unet)(scope, frames, n)
    masks = tf.nn.softmax(tf.concat([logits, tf.ones_like(logits[..., :1])], 3), 3)
    masked = tf.stack([masks[..., i:i + 1] * frames for i in range(n)])
    h = tf.concat(tf.unstack(masked), 0)
    if task.deep:
        h = tf.nn.avg_pool2d(h, 2, 2, "SAME")
    h = scope.dense(tf.reshape(h, [h.shape[0], -1]), 200, tf.nn.relu)
    h = scope.dense(scope.dense(h, 200, tf.nn.relu), 2)
    pos = tf.tanh(h) * half + half
    return tf.concat(tf.split(pos, n, 0), 1), masks, masked


def vel_encoder(variables, task, pos):
    """Positions of the input frames [B, L, 2 N] to velocities [B, 2 N], one object at a time."""
    scope, n = blocks.Scope(variables, "net/init_vel"), task.objects
    if task.input_steps == 1:
        return tf.zeros_like(pos[:, 0])
    if task.alt_vel:
        pos = pos[:, 1:] - pos[:, :-1]
    h = tf.concat(tf.split(pos, n, 2), 0)
    h = tf.reshape(h, [h.shape[0], -1])
    if not task.alt_vel:
        h = scope.dense(scope.dense(h, 100, tf.tanh), 100, tf.tanh)
    return tf.concat(tf.split(scope.dense(h, 2), n, 0), 1)


def sprites(scope, task):
    """Templates [N, t, t, 1], contents [N, t, t, 3] (before the sigmoid), background [1, S, S, 3] (after it)."""
    n, s, t = task.objects, task.side, task.side // 2
    template = blocks.variable_from_network(scope, [n, t, t, 1])
    contents = blocks.variable_from_network(scope, [n, t, t, 3])
    background = blocks.variable_from_network(scope, [1, s, s, 3])
    return template, contents, tf.sigmoid(background)


def decoder(variables, task, pos):
    """Positions [B, 2 N] to frames [B, S, S, 3], masks [N + 1, B, S, S, 1], contents [N + 1, B, S, S, 3], sprites."""
    scope, s, t, batch = blocks.Scope(variables, "net/decoder"), task.side, task.side // 2, pos.shape[0]
    sigma = tf.repeat(tf.exp(scope.scalar("logsigma")), batch)
    template, contents, background = sprites(scope, task)
    zero, logits, colours = tf.zeros_like(sigma), [], []
    for i, object_pos in enumerate(tf.split(pos, task.objects, 1)):
        x, y = tf.unstack(object_pos, axis=1)
        theta = tf.stack([sigma, zero, (s / 2 - x) / t * sigma, zero, sigma, (s / 2 - y) / t * sigma], 1)
        sprite = tf.concat([template[i] + 5, tf.sigmoid(contents[i])], 2)
        moved = stn(tf.tile(sprite[None], [batch, 1, 1, 1]), theta, s)
        logits.append(moved[..., :1] - 5)
        colours.append(moved[..., 1:])
    masks = tf.nn.softmax(tf.stack([*logits, tf.ones_like(logits[0])]), 0)
    colours = tf.stack([*colours, tf.tile(background, [batch, 1, 1, 1])])
    return tf.reduce_sum(masks * colours, 0), masks, colours, (template, contents, background)


def physics_net(variables, task, clips):
    """The whole model on clips [B, T, S, S, 3] in [0, 1]."""
    batch, time, s = clips.shape[0], clips.shape[1], task.side
    encoded = task.input_steps + task.pred_steps

    # encoder -> decoder
    pos, masks, masked = encoder(variables, task, tf.reshape(clips[:, :encoded], [-1, s, s, 3]))
    enc_pos = tf.reshape(pos, [batch, encoded, -1])
    recons_out, _, _, (template, contents, background) = decoder(variables, task, pos)
    recons_out = tf.reshape(recons_out, [batch, encoded, s, s, 3])

    # velocity -> physics -> decoder
    vel = vel_encoder(variables, task, enc_pos[:, :task.input_steps])
    pos = enc_pos[:, task.input_steps - 1]
    scope, cell = blocks.Scope(variables, f"net/{task.cell}"), CELLS[task.cell]
    states, positions = [tf.concat([pos, vel], 1)], []
    for _ in range(task.input_steps, time):
        pos, vel = cell(scope, pos, vel, task.dt, side=task.side)
        states.append(tf.concat([pos, vel], 1))
        positions.append(pos)
    output, out_masks, out_contents, _ = decoder(variables, task, tf.concat(positions, 0))
    output = tf.stack(tf.split(output, len(positions), 0), 1)

    # losses
    future = clips[:, task.input_steps:]
    recons_loss = frame_error(recons_out, clips[:, :encoded])
    pred_loss = frame_error(output[:, :task.pred_steps], future[:, :task.pred_steps])
    extrap_loss = frame_error(output[:, task.pred_steps:], future[:, task.pred_steps:])
    return SimpleNamespace(
        enc_masks=masks, masked_objs=masked, enc_pos=enc_pos, recons_out=recons_out, pos_vel_seq=tf.stack(states, 1),
        output=output, template=template, contents=contents, background_content=background,
        last_masks=tf.repeat(out_masks[:, -batch:], 3, 4), last_contents=out_contents[:, -batch:],
        recons_loss=recons_loss, pred_loss=pred_loss, extrap_loss=extrap_loss,
        train_loss=pred_loss + task.alpha * recons_loss)


def frame_error(x, y):
    """Squared error summed over a frame, averaged over batch and time."""
    return tf.reduce_mean(tf.reduce_sum((x - y) ** 2, [2, 3, 4]))

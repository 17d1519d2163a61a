"""Physics cells (original: cells.py): pos and vel are [B, 2 N] as (x0, y0, x1, y1, ..), one call is one frame."""
import tensorflow as tf

SUBSTEPS = 5


def bouncing_ode_cell(scope, pos, vel, dt, side=32, radius=2):
    near, far = radius, side - radius
    for _ in range(SUBSTEPS):
        pos = pos + dt / SUBSTEPS * vel
        vel = tf.where(pos > far, -vel, vel)
        vel = tf.where(pos < near, -vel, vel)
        pos = tf.where(pos > far, 2 * far - pos, pos)
        pos = tf.where(pos < near, 2 * near - pos, pos)
    return pos, vel


def spring_ode_cell(scope, pos, vel, dt, side=None):
    k, l = tf.exp(scope.scalar("log_k")), tf.exp(scope.scalar("log_l"))
    h = dt / SUBSTEPS
    for _ in range(SUBSTEPS):
        p0, p1 = tf.split(pos, 2, 1)
        v0, v1 = tf.split(vel, 2, 1)
        d = p0 - p1
        n = tf.sqrt(tf.reduce_sum(d**2, 1, keepdims=True))
        force = k * (n - 2 * l) * d / (n + 1e-4)
        vel = tf.concat([v0 - h * force, v1 + h * force], 1)
        pos = pos + h * vel
    return pos, vel


def gravity_ode_cell(scope, pos, vel, dt, side=None, log_m=0.0):
    """`log_m` is fixed: only g m^2 enters."""
    log_g = scope.scalar("log_g")
    a = tf.exp(log_g) * tf.exp(tf.cast(2 * log_m, log_g.dtype))
    h = dt / SUBSTEPS
    for _ in range(SUBSTEPS):
        p0, p1, p2 = tf.split(pos, 3, 1)
        f01, f12, f20 = attraction(p0 - p1), attraction(p1 - p2), attraction(p2 - p0)
        force = -a * tf.concat([f01 - f20, f12 - f01, f20 - f12], 1)
        vel = vel + h * force
        pos = pos + h * vel
    return pos, vel


def attraction(d):
    n = tf.sqrt(tf.clip_by_value(tf.reduce_sum(d**2, 1, keepdims=True), 0.1, 1e5))
    n = tf.clip_by_value(n, 1, 170)
    return d / (n * n * n)


CELLS = {cell.__name__: cell for cell in (bouncing_ode_cell, spring_ode_cell, gravity_ode_cell)}

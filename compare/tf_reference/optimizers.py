"""The original's optimizers are TensorFlow 1's own, which TensorFlow 2 still has (original: base.py)."""
import tensorflow as tf

v1 = tf.compat.v1.train


def optimizer(task, dtype):
    def number(x):
        return tf.constant(x, dtype)

    lr = number(task.base_lr)
    if task.opt == "rmsprop":
        return v1.RMSPropOptimizer(lr, decay=number(0.9), momentum=number(0.0), epsilon=number(1e-10))
    if task.opt == "adam":
        return v1.AdamOptimizer(lr, beta1=number(0.9), beta2=number(0.999), epsilon=number(1e-8))
    if task.opt == "momentum":
        return v1.MomentumOptimizer(lr, number(0.9))
    return v1.GradientDescentOptimizer(lr)


def step(rule, gradients, variables):
    """One step; every element of a gradient is clipped to [-1, 1]."""
    clipped = [None if g is None else tf.clip_by_value(g, -1, 1) for g in gradients]
    return rule.apply_gradients([(g, v) for g, v in zip(clipped, variables) if g is not None])

"""Times training steps in TensorFlow, as a graph; with --xla as one that XLA compiles; with --session as the original runs
them, by a session of TensorFlow 1 that is fed arrays: python -m tf_reference.speed --task spring_color"""
import sys

import numpy as np
import tensorflow as tf

from shared.speed import main

from .blocks import Variables
from .optimizers import optimizer, step
from .physics_models import physics_net


def functions(xla):
    """Steps of TensorFlow 2."""
    def repetition(_what, task, batch, threads):
        tf.config.threading.set_intra_op_parallelism_threads(threads)
        tf.config.threading.set_inter_op_parallelism_threads(1)
        variables, rule = Variables(), optimizer(task, "float32")

        def eager(clips):
            with tf.GradientTape() as tape:
                loss = physics_net(variables, task, clips).train_loss
            step(rule, tape.gradient(loss, list(variables.values())), variables.values())
            return loss

        clips = tf.random.uniform([batch, task.seq_len, task.side, task.side, 3])
        physics_net(variables, task, clips[:1])  # makes the variables
        eager(clips[:1])  # and the optimizer's
        graph = tf.function(eager, jit_compile=xla)
        return lambda: graph(clips).numpy()
    return repetition


def sessions(_what, task, batch, threads):
    """Steps of TensorFlow 1 (original: base.py)."""
    v1, shape = tf.compat.v1, [batch, task.seq_len, task.side, task.side, 3]
    with tf.Graph().as_default():
        variables, fed = Variables(), v1.placeholder(tf.float32, shape)
        loss = physics_net(variables, task, fed).train_loss
        learned = list(variables.values())
        update = step(optimizer(task, "float32"), tf.gradients(loss, learned), learned)
        session = v1.Session(config=v1.ConfigProto(intra_op_parallelism_threads=threads, inter_op_parallelism_threads=1))
        session.run(v1.global_variables_initializer())
    clips = np.random.default_rng(0).random(shape, np.float32)
    return lambda: session.run([update, loss], {fed: clips})


MODES = {"--xla": functions(True), "--session": sessions}

if __name__ == "__main__":
    mode = next((argument for argument in sys.argv if argument in MODES), None)
    sys.argv = [argument for argument in sys.argv if argument != mode]
    main(MODES.get(mode, functions(False)))

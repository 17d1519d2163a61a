"""Times training steps in TensorFlow, as a graph like the original's, or with --xla as one that XLA compiles:
python -m tf_reference.speed --task spring_color"""
import sys

import tensorflow as tf

from shared.speed import main

from .blocks import Variables
from .optimizers import optimizer, step
from .physics_models import physics_net


def new(xla):
    return lambda _what, task, batch, threads: repetition(xla, task, batch, threads)


def repetition(xla, task, batch, threads):
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


if __name__ == "__main__":
    xla = "--xla" in sys.argv
    sys.argv = [argument for argument in sys.argv if argument != "--xla"]
    main(new(xla))

"""Reads a TensorFlow 1 checkpoint of the original into named variables (.npz), for the `convert` program:

    python -m tf_reference.read_checkpoint path/model.ckpt-500 weights.npz
"""
import argparse

import numpy as np
import tensorflow as tf


def read_checkpoint(prefix):
    """{name: array} of the network's variables; slots of the optimizer and counters are left out."""
    reader = tf.train.load_checkpoint(str(prefix))
    return {name: reader.get_tensor(name) for name in sorted(reader.get_variable_to_shape_map()) if is_variable(name)}


def is_variable(name):
    last = name.split("/")[-1]
    return name.startswith("net/") and (last in ("kernel", "bias", "logsigma") or last.startswith("log_"))


def write_checkpoint(prefix, weights):
    """A checkpoint as TensorFlow 1 saves it in training: with a step counter and the slots of RMSProp."""
    v1 = tf.compat.v1
    with tf.Graph().as_default(), v1.Session() as session:
        variables = [v1.get_variable(name, initializer=tf.constant(x)) for name, x in weights.items()]
        step = v1.train.get_or_create_global_step()
        loss = tf.add_n([tf.reduce_sum(v) for v in variables])
        v1.train.RMSPropOptimizer(1e-3).minimize(loss, step, variables)
        session.run(v1.global_variables_initializer())
        return v1.train.Saver().save(session, str(prefix), global_step=0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", help="as TensorFlow names it: without .index or .data")
    parser.add_argument("out", help=".npz file to write")
    arguments = parser.parse_args()
    try:
        variables = read_checkpoint(arguments.checkpoint)
    except (tf.errors.OpError, ValueError) as error:
        parser.error(f"{arguments.checkpoint}: {str(error).splitlines()[0]}")
    if not variables:
        parser.error(f"{arguments.checkpoint}: holds no variable under net/")
    np.savez(arguments.out, **variables)
    print(f"{len(variables)} variables in {arguments.out}")


if __name__ == "__main__":
    main()

"""The spatial transformer (original: stn.py)."""
import tensorflow as tf


def stn(images, theta, side):
    """Samples images [B, h, w, C] under theta [B, 6] into [B, side, side, C]."""
    batch, height, width, channels = images.shape
    line = tf.linspace(tf.constant(-1, images.dtype), tf.constant(1, images.dtype), side)
    gx, gy = (tf.reshape(g, [-1]) for g in tf.meshgrid(line, line))
    source = tf.reshape(theta, [batch, 2, 3]) @ tf.stack([gx, gy, tf.ones_like(gx)])
    x0, x1, wx0, wx1 = indices_and_weights(source[:, 0], width)
    y0, y1, wy0, wy1 = indices_and_weights(source[:, 1], height)

    def gather(y, x):
        return tf.gather_nd(images, tf.cast(tf.stack([y, x], 2), tf.int32), batch_dims=1)

    sampled = ((wx0 * wy0)[..., None] * gather(y0, x0) + (wx0 * wy1)[..., None] * gather(y1, x0)
               + (wx1 * wy0)[..., None] * gather(y0, x1) + (wx1 * wy1)[..., None] * gather(y1, x1))
    return tf.reshape(sampled, [batch, side, side, channels])


def indices_and_weights(source, size):
    """Pixels below and above, clipped to the image, and their weights, taken from the clipped indices."""
    pixel = (source + 1) * (size - 1.01) / 2
    below = tf.stop_gradient(tf.floor(pixel))
    low, high = tf.clip_by_value(below, 0, size - 1), tf.clip_by_value(below + 1, 0, size - 1)
    return low, high, high - pixel, pixel - low

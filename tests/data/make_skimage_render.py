"""Makes skimage_render.npz and numpy_*.npz, which tests/generators.rs compares the Rust code with.

    pip install scikit-image==0.25.2 numpy==2.4.6
    python tests/data/make_skimage_render.py

skimage_render.npz: `balls_<side>_{positions,frames}` and `digits_{positions,frames}`: positions float64 [scenes,
objects, 2] as (x, y) in pixels, frames uint8 [scenes, S, S, 3], drawn as the original's generators draw them (canvas
10 times or, for digits, 5 times as large, then skimage's anti-aliased resize). numpy_savez.npz and
numpy_savez_compressed.npz: small datasets as numpy writes them, clips [2, 3, 4, 4, 3] counting up from 0 in train_x,
1 in valid_x, 2 in test_x (mod 256).
"""

from pathlib import Path

import numpy as np
from skimage.draw import disk
from skimage.transform import resize

HERE = Path(__file__).parent
ASSETS = np.load(HERE.parents[1] / "data/assets/mnist_cifar_assets.npz")
RADIUS = 2
BALL_SCALE, DIGIT_SCALE, DIGIT_RADIUS = 10, 5, 11


def shrink(canvas, side):
    return (resize(canvas, (side, side), anti_aliasing=True) * 255).astype(np.uint8)


def balls(positions, side):
    canvas = np.zeros((side * BALL_SCALE, side * BALL_SCALE, 3), dtype=np.float32)
    for j, (x, y) in enumerate(positions):
        centre = (int(y * BALL_SCALE), int(x * BALL_SCALE))
        rows, columns = disk(centre, RADIUS * BALL_SCALE, shape=canvas.shape[:2])
        canvas[rows, columns, 2 - j] = 1
    return shrink(canvas, side)


def digits(positions, side):
    size = side * DIGIT_SCALE
    canvas = np.clip(resize(ASSETS["cifar10_train_1"] / 255, (size, size)) - 0.2, 0, 1)
    sprite_size = 2 * DIGIT_RADIUS * DIGIT_SCALE
    for j, (x, y) in enumerate(positions):
        sprite = resize(ASSETS["mnist_train_0_1"][j, 3:-3, 3:-3] / 255, (sprite_size, sprite_size))
        top, left = (round((p - DIGIT_RADIUS) * DIGIT_SCALE) for p in (y, x))
        opacity = np.zeros((size, size, 1))
        rows = slice(max(top, 0), min(top + sprite_size, size))
        columns = slice(max(left, 0), min(left + sprite_size, size))
        opacity[rows, columns, 0] = sprite[rows.start - top:rows.stop - top, columns.start - left:columns.stop - left]
        canvas = opacity * np.eye(3)[j] + (1 - opacity) * canvas
    return shrink(canvas, side)


def main():
    rng = np.random.default_rng(0)
    arrays = {}
    for side, objects, scenes in ((32, 2, 30), (36, 3, 16)):
        positions = rng.uniform(RADIUS, side - RADIUS, (scenes, objects, 2))
        # Touching the borders, within the blur's reach of them, and cut by them.
        positions[0] = RADIUS
        positions[1] = side - RADIUS
        positions[2] = [RADIUS + 0.05, side - RADIUS - 0.05]
        positions[3] = [side - RADIUS - 1.3, RADIUS + 1.3]
        positions[4] = [0.4, side - 0.4]
        arrays[f"balls_{side}_positions"] = positions
        arrays[f"balls_{side}_frames"] = np.stack([balls(scene, side) for scene in positions])
    positions = rng.uniform(2, 62, (10, 2, 2))
    positions[0] = [[20.0, 20.0], [24.0, 22.0]]
    positions[1] = [[2.1, 2.1], [61.9, 61.9]]
    arrays["digits_positions"] = positions
    arrays["digits_frames"] = np.stack([digits(scene, 64) for scene in positions])
    np.savez_compressed(HERE / "skimage_render.npz", **arrays)

    count = np.arange(2 * 3 * 4 * 4 * 3).reshape(2, 3, 4, 4, 3)
    small = {f"{split}_x": (count + i).astype(np.uint8) for i, split in enumerate(("train", "valid", "test"))}
    np.savez(HERE / "numpy_savez.npz", **small)
    np.savez_compressed(HERE / "numpy_savez_compressed.npz", **small)


if __name__ == "__main__":
    main()

"""The generated videos, as random frames and as shuffled clips; what a step sees depends on seed and step alone."""
import zlib
from pathlib import Path

import numpy as np
import torch

DATASETS = Path(__file__).resolve().parents[3] / "data/datasets"
FILES = {
    "spring_color": ("spring_color/color_spring_vx8_vy8_sl12_r2_k4_e6.npz",
                     "spring_color/color_spring_vx8_vy8_sl30_r2_k4_e6.npz"),
    "3bp_color": ("3bp_color/color_3bp_vx2_vy2_sl20_r2_g60_m1_dt05.npz",
                  "3bp_color/color_3bp_vx2_vy2_sl40_r2_g60_m1_dt05.npz"),
}


class MissingData(Exception):
    pass


def generator(seed, purpose, step=0):
    return np.random.default_rng([seed, zlib.crc32(purpose.encode()), step])


class Clips:
    """uint8 [clips, time, S, S, 3]; `reshaped` is defect 1: reshaped, not permuted, to channels first."""

    def __init__(self, pixels, reshaped):
        self.pixels, self.reshaped = torch.from_numpy(pixels), reshaped

    def __len__(self):
        return len(self.pixels)

    def to_frames(self, pixels):
        x = pixels.float() / 255
        if self.reshaped:
            *outer, height, width, channels = x.shape
            return x.reshape(*outer, channels, height, width)
        return x.movedim(-1, -3)

    def batch(self, clips, frames):
        """The first frames of these clips, [batch, frames, 3, S, S]."""
        return self.to_frames(self.pixels[torch.as_tensor(clips), :frames])

    def random_frames(self, count, seed, purpose, step=0):
        """[count, 3, S, S], from all clips."""
        frames = self.pixels.flatten(0, 1)
        places = generator(seed, purpose, step).integers(0, len(frames), count)
        return self.to_frames(frames[torch.from_numpy(places)])

    def shuffled(self, batch, seed, step):
        """The clips of a step of shuffled passes; the last partial batch of a pass is dropped."""
        steps_per_epoch = len(self) // batch
        order = generator(seed, "order", step // steps_per_epoch).permutation(len(self))
        first = step % steps_per_epoch * batch
        return order[first:first + batch]


def load_clips(task_key, reshaped):
    """Training, validation and test clips; the test clips are those of the file of long ones."""
    paths = [DATASETS / name for name in FILES[task_key]]
    for path in paths:
        if not path.exists():
            raise MissingData(f"{path.relative_to(DATASETS.parents[1])} is missing; make it with: "
                              f"cargo run --release --bin generate -- --task {task_key}")
    with np.load(paths[0]) as short, np.load(paths[1]) as long:
        arrays = short["train_x"], short["valid_x"], long["test_x"]
    return [Clips(array, reshaped) for array in arrays]

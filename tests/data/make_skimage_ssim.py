"""Makes skimage_ssim.npz, which tests/ssim.rs compares the Rust code with.

    pip install scikit-image==0.26.0 numpy
    python tests/data/make_skimage_ssim.py

`first` and `second`: float32 [pairs, S, S, 3] in [0, 1]; `ssim`: float64 [pairs]. The pairs: balls a pixel apart, equal
frames, noise with more noise, nothing against balls in the corners.
"""

from pathlib import Path

import numpy as np
from skimage.metrics import structural_similarity

random = np.random.default_rng(0)
side = 32
y, x = np.mgrid[0:side, 0:side]


def balls(*centres):
    image = np.zeros((side, side, 3), np.float32)
    for channel, (cx, cy) in enumerate(centres):
        image[..., channel] = np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 8)
    return image


noise = random.random((side, side, 3), np.float32)
first = np.stack([balls((9, 9), (20, 22)), balls((9, 9), (20, 22)), noise, np.zeros_like(noise)])
second = np.stack(
    [
        balls((10, 9), (20, 21)),
        balls((9, 9), (20, 22)),
        np.clip(noise + 0.2 * random.standard_normal(noise.shape), 0, 1),
        balls((3, 30), (28, 2)),
    ]
).astype(np.float32)
# Float64: in float32 skimage itself is exact only to about 1e-4 where images are flat.
similarity = np.array([
    structural_similarity(
        a.astype(np.float64), b.astype(np.float64), gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        data_range=1.0, channel_axis=-1)
    for a, b in zip(first, second)
])
np.savez_compressed(Path(__file__).parent / "skimage_ssim.npz", first=first, second=second, ssim=similarity)
print(similarity)

"""An equation and clips of your own: a ball on a damped spring whose rest position is learned."""

import numpy as np

import paig

pull = paig.Equation(
    "-k * (p - vec(x0, y0)) - b * v",
    parameters={
        "k": {"unit": (0, -2)}, "b": {"unit": (0, -1), "start": 0.1}, "x0": {"unit": (1, 0), "start": 16.0},
        "y0": {"unit": (1, 0), "start": 16.0}})


def film(count: int, frames: int, dt: float) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Clips of a white disc of radius 3 px, `[clips, frames, 32, 32, 1]`: k = 3, b = 0.2, rest position (17, 14)."""
    random, steps = np.random.default_rng(0), 50
    place, speed = random.uniform(8, 24, (count, 2)), random.uniform(-8, 8, (count, 2))
    rows, columns = np.mgrid[0:32, 0:32] + 0.5
    clips = np.empty((count, frames, 32, 32, 1), np.uint8)
    for frame in range(frames):
        distance = np.hypot(columns - place[:, 0, None, None], rows - place[:, 1, None, None])
        clips[:, frame, :, :, 0] = 255 * np.clip(3.5 - distance, 0, 1)
        for _ in range(steps):
            speed = speed + dt / steps * (-3.0 * (place - [17.0, 14.0]) - 0.2 * speed)
            place = place + dt / steps * speed
    return clips


run = paig.train(film(600, 20, 0.15), equation=pull, dt=0.15, out="pull")
print(run.parameters)
print(run.verdict)

"""The task table: what a system's videos look like and how they are cut into input and prediction."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    key: str
    side: int          # S, pixels
    objects: int       # N
    seq_len: int       # frames of a training clip
    input_steps: int   # L
    pred_steps: int    # T_pred
    cell: str
    dt: float          # time between two frames
    base_lr: float
    alpha: float       # weight of the reconstruction loss
    alt_vel: bool = False
    opt: str = "rmsprop"

    @property
    def deep(self):
        """Frames from 40 px go through the deep U-Net and are halved before the dense layers."""
        return self.side >= 40


TASKS = {task.key: task for task in [
    Task("bouncing_balls", 32, 2, 12, 4, 6, "bouncing_ode_cell", 0.3, 3e-4, 2.0),
    Task("spring_color", 32, 2, 12, 4, 6, "spring_ode_cell", 0.3, 6e-4, 3.0),
    Task("spring_color_half", 32, 2, 12, 4, 6, "spring_ode_cell", 0.3, 6e-4, 3.0),
    Task("mnist_spring_color", 64, 2, 12, 3, 7, "spring_ode_cell", 0.3, 6e-4, 3.0),
    Task("3bp_color", 36, 3, 20, 4, 12, "gravity_ode_cell", 0.5, 1e-3, 5.0),
]}


def of_stem(rest):
    """The task whose key a file name (after the case's own prefix) starts with; the longest key if several do."""
    keys = [key for key in TASKS if rest.startswith(key)]
    return TASKS[max(keys, key=len)] if keys else None

"""The twelve known defects of earlier ports, each to be switched on alone; all off is the original."""
from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Defects:
    """In the order of their numbers, 1 to 12."""
    reshaped_frames: bool = False      # channels-last frames reshaped, not permuted, to channels-first
    split_by_size: bool = False        # split(x, 1): parts of size 1 where TensorFlow makes 2 parts
    late_start: bool = False           # roll-out from frame L + 2, prediction loss over the clip's last T_pred frames
    default_initial: bool = False      # PyTorch's initial values, not Glorot's and zero
    torch_rmsprop: bool = False        # RMSprop from zero, epsilon outside of the root, decay 0.99
    no_clipping: bool = False          # gradients not clipped
    no_annealing: bool = False         # the annealed rate never reaches the optimizer
    relu_logits: bool = False          # ReLU on the mask logits
    half_pixel: bool = False           # half-pixel, antialiased up-sampling
    grid_sample: bool = False          # grid_sample with its default corners and border
    fixed_sigma: bool = False          # sigma is not learned
    strength_once: bool = False        # gravity's strength is computed once

    @classmethod
    def number(cls, n):
        """Defect n alone; 0 is none."""
        names = [field.name for field in fields(cls)]
        if not 0 <= n <= len(names):
            raise ValueError(f"there are defects 1 to {len(names)}, not {n}")
        return cls(**{names[n - 1]: True}) if n else cls()

"""The twelve known defects of earlier ports, each to be switched on alone; all off is the original."""
from dataclasses import dataclass, field, fields


def defect(what):
    return field(default=False, metadata={"what": what})


@dataclass(frozen=True)
class Defects:
    """In the order of their numbers, 1 to 12."""
    reshaped_frames: bool = defect("channels-last frames reshaped, not permuted, to channels first")
    split_by_size: bool = defect("`split(x, 1)`: parts of size 1 where TensorFlow makes 2 parts")
    late_start: bool = defect("roll-out from frame L + 2, prediction loss over the clip's last T_pred frames")
    default_initial: bool = defect("PyTorch's initial values, not Glorot's and zero")
    torch_rmsprop: bool = defect("PyTorch's RMSprop: from zero, epsilon outside of the root, decay 0.99")
    no_clipping: bool = defect("gradients not clipped")
    no_annealing: bool = defect("the annealed rate never reaches the optimizer")
    relu_logits: bool = defect("ReLU on the mask logits")
    half_pixel: bool = defect("half-pixel, antialiased up-sampling")
    grid_sample: bool = defect("`grid_sample` with its default corners and border")
    fixed_sigma: bool = defect("sigma is not learned")
    strength_once: bool = defect("gravity's strength is computed once")

    @classmethod
    def number(cls, n):
        """Defect n alone; 0 is none."""
        names = [each.name for each in fields(cls)]
        if not 0 <= n <= len(names):
            raise ValueError(f"there are defects 1 to {len(names)}, not {n}")
        return cls(**{names[n - 1]: True}) if n else cls()


def descriptions():
    """In words, by number."""
    return {n: each.metadata["what"] for n, each in enumerate(fields(Defects), 1)}

"""What is trained: the numbers of recipe.toml under those of overrides.toml, and the kinds of trainings."""
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

from shared.tasks import TASKS

from ..optimizers import OPTIMIZERS, TorchRMSProp
from ..switches import Defects

HERE = Path(__file__).resolve().parent
FAST, OVERRIDES = HERE / "recipe.toml", HERE / "overrides.toml"


def fast_recipe(task_key):
    """The sections that training reads."""
    recipe, overrides = (tomllib.loads(path.read_text()) for path in (FAST, OVERRIDES))
    own = overrides.pop("task").get(task_key, {})
    recipe = merged(merged(recipe, overrides), own)
    return {section: recipe[section] for section in ("model", "discover", "identify", "join")}


def merged(under, over):
    if not isinstance(over, dict):
        return over
    return under | {name: merged(under[name], value) for name, value in over.items()}


@dataclass(frozen=True)
class Training:
    """`rmsprop`: TensorFlow's RMSProp with clipped gradients, the original's optimizer, in place of Adam."""
    defect: int = 0
    task_key: str = "spring_color"
    rmsprop: bool = False

    @property
    def task(self):
        return TASKS[self.task_key]

    @property
    def defects(self):
        return Defects.number(self.defect)

    def acts_in_discovery(self):
        """Whether the defect does; if not, discovery is that of the faithful port, to the bit."""
        return self.defects not in (Defects(), Defects.number(2), Defects.number(3), Defects.number(12))

    def discovery(self):
        """The training with the same first phase and no defect that acts later."""
        return self if self.acts_in_discovery() else replace(self, defect=0)

    def optimizer(self, parameters, rate):
        """The recipe's Adam without clipping; or RMSProp, on which defects 5 and 6 act. Defect 7 acts on both."""
        defects = self.defects
        if not self.rmsprop:
            result = OPTIMIZERS["adam"](parameters, rate, clip=None)
        else:
            rule = TorchRMSProp if defects.torch_rmsprop else OPTIMIZERS["rmsprop"]
            result = rule(parameters, rate, clip=None if defects.no_clipping else 1.0)
        result.anneals = not defects.no_annealing
        return result

"""Physics-as-Inverse-Graphics: objects, positions and physical parameters from unlabelled video.

::

    import paig

    spring = paig.generate("spring_color", train=1000, valid=100, test=100)
    run = paig.train(spring, out="runs/spring")
    run.parameters["k"].value, run.parameters["k"].interval

    drop = paig.import_video("drop.mp4", "drop", equation="falling", scale=(102, 74, 145, 1636, 2.28))
    paig.train(drop).measurement

`import paig` needs no libtorch; the first call that computes loads it (`paig.libtorch`).
"""

from __future__ import annotations

from importlib.metadata import version as _version

from . import errors
from .datasets import Clips, Dataset, dataset, generate, generate_clips, tasks
from .equation import Equation
from .errors import Error
from .events import Event
from .measurement import Measurement
from .model import Model, States
from .runs import Prediction, Run, Verdict, load, runs
from .tables import Parameter, Table
from .training import Training, resume, train
from .versions import versions
from .video import Track, import_video, track

__version__ = _version("paig")

__all__ = [
    "Clips", "Dataset", "Equation", "Error", "Event", "Measurement", "Model", "Parameter", "Prediction", "Run", "States",
    "Table", "Track", "Training", "Verdict", "__version__", "dataset", "errors", "generate", "generate_clips", "import_video",
    "load", "resume", "runs", "tasks", "track", "train", "versions",
]

"""Training."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ._native import native
from .arrays import Array
from .datasets import Dataset, dataset
from .equation import Equation
from .errors import FailedError, InputError
from .events import Event, Progress, listener
from .runs import Run

__all__ = ["Training", "resume", "train"]

Settings = Mapping[str, Any]


def train(
    task: Dataset | str | Path | Array,
    *,
    equation: Equation | str | None = None,
    dt: float | None = None,
    objects: int | None = None,
    out: str | Path | None = None,
    data: str | Path | None = None,
    recipe: str | None = None,
    seed: int | None = None,
    device: str | None = None,
    threads: int | None = None,
    settings: Settings | None = None,
    config: str | Path | None = None,
    progress: Progress = True,
) -> Run:
    """Train on a task: learn objects, positions and parameters from its clips, judge, score, draw. As `paig train`.

    Ctrl-C stops after the step at hand and saves; `paig.resume` continues to the same bits. The GIL is released.

    Args:
        task: A `paig.Dataset`; the name of a built-in task, or a task file, whose clips lie in `data`; or clips `[clips, time,
            side, side, channels]` of any library, with `equation` and `dt`.
        equation: Of clips from an array.
        dt: Of clips from an array: time between two frames, in the unit that the parameters are to be in.
        objects: Of clips from an array; by default that of the equation.
        out: The run's folder; by default `runs/TASK/RECIPE/seed=N`. Clips from an array are written to `OUT-data`.
        data: The datasets folder; by default `data/datasets`, or that of the dataset.
        recipe: `fast` (default) or `paper`.
        seed: Of initial values and of the order of the data.
        device: `cpu`, `cuda` or `cuda:n`.
        threads: 0 for one a core. The same number gives the same bits.
        settings: Keys of the config: `{"join.batch": 50}`.
        config: A config file.
        progress: Whether to print it, or what is called with each `paig.Event`. An exception in it stops and saves the run.

    Raises:
        KeyboardInterrupt: Stopped and saved.
        paig.errors.Error: By its kind.
    """
    return _run(_request(**locals()), progress)


def resume(folder: str | Path, *, device: str | None = None, threads: int | None = None, progress: Progress = True) -> Run:
    """Continue a run that was stopped, to the same bits as if it had not been (with as many threads)."""
    request = {"out": str(folder), "resume": True, "device": device, "threads": threads}
    return _run({key: value for key, value in request.items() if value is not None}, progress)


class Training:
    """A training whose events are iterated over; it goes on in the background, and the loop's end is its own.

    ::

        training = paig.Training(dataset, seed=1)
        for event in training:
            print(event.kind, event.step)
        training.run.parameters
    """

    def __init__(self, task: Dataset | str | Path | Array, **arguments: Any) -> None:
        """Take the arguments of `train`, but for `progress`."""
        self._request = _request(task, **arguments)
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._run: Run | None = None
        self._error: BaseException | None = None

    def stop(self) -> None:
        """Stop after the step at hand and save; the loop ends."""
        self._stop.set()

    @property
    def run(self) -> Run:
        """The run, once the loop has ended."""
        if self._run is None:
            raise FailedError("the training has not finished")
        return self._run

    def __iter__(self) -> Iterator[Event]:
        thread = threading.Thread(target=self._work)
        thread.start()
        try:
            while (event := self._events.get()) is not None:
                yield event
        finally:
            self._stop.set()
            thread.join()
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        try:
            self._run = _run(self._request, self._tell)
        except _Stopped:
            pass
        except BaseException as error:
            self._error = error
        finally:
            self._events.put(None)

    def _tell(self, event: Event) -> None:
        self._events.put(event)
        if self._stop.is_set():
            raise _Stopped


class _Stopped(Exception):
    """Ends a training that is no longer listened to."""


def _request(
    task: Dataset | str | Path | Array,
    *,
    equation: Equation | str | None = None,
    dt: float | None = None,
    objects: int | None = None,
    out: str | Path | None = None,
    data: str | Path | None = None,
    recipe: str | None = None,
    seed: int | None = None,
    device: str | None = None,
    threads: int | None = None,
    settings: Settings | None = None,
    config: str | Path | None = None,
    progress: object = None,
) -> dict[str, Any]:
    """The request of the native module."""
    if not isinstance(task, (Dataset, str, Path)):
        if equation is None or dt is None or out is None:
            raise InputError("clips from an array need equation, dt and out")
        task = dataset(task, folder=f"{out}-data", equation=equation, dt=dt, objects=objects, name=_name(out))
    elif equation is not None or dt is not None or objects is not None:
        raise InputError("equation, dt and objects are for clips from an array; a task has its own")
    if isinstance(task, Dataset):
        data = data if data is not None else task.folder
        task = task.task
    given = {
        "task": str(task), "out": out and str(out), "data": data and str(data), "recipe": recipe, "seed": seed,
        "device": device, "threads": threads, "config": config and str(config),
        "set": [f"{key}={_toml(value)}" for key, value in (settings or {}).items()]}
    return {key: value for key, value in given.items() if value is not None}


def _run(request: dict[str, Any], progress: Progress) -> Run:
    listen, end = listener(progress)
    try:
        ending = json.loads(native.train(json.dumps(request), listen))
    finally:
        end()
    if ending.get("measurement"):
        raise FailedError(ending["measurement"])
    return Run(ending["folder"])


def _name(out: str | Path) -> str:
    name = Path(out).name.lower()
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter == "_") else "-" for letter in name).strip("-")


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return value
    return json.dumps(value)

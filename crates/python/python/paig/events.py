"""What happens in a run, and how it is shown."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Union

__all__ = ["Event", "Progress"]


@dataclass(frozen=True)
class Event:
    """Something that happened in a run."""

    kind: str
    """`begin`, `resumed`, `phase`, `step`, `record`, `note`, `checkpoint`, `scores`, `finished`, `interrupted`; of
    generators and imports `clips`, `frames`, `wrote`, `kept`."""
    phase: str = ""
    """`discover`, `identify`, `join`, `scoring`, `pictures`."""
    step: int = 0
    """Steps done in the phase."""
    of: int = 0
    """Steps at most; 0 where a phase has none."""
    loss: float | None = None
    """Training loss of the step."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """The parameters after the step, lengths in pixels."""
    seconds_left: float | None = None
    """At most, to the end of the training."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """All of the event, as the program's `metrics.jsonl` has it."""

    @classmethod
    def read(cls, text: str) -> Event:
        details = json.loads(text)
        record = details.get("record", {})
        return cls(
            details["event"], details.get("phase") or record.get("phase", ""), details.get("step") or record.get("step", 0),
            details.get("of", 0), details.get("loss"), details.get("parameters", {}), details.get("seconds_left"), details)


# Whether progress is printed, or what is called with each event.
Progress = Union[bool, Callable[[Event], object]]


class Printer:
    """A line that is written over on a terminal or in a notebook, lines that stay elsewhere; on standard error."""

    INTERVAL = 0.2

    def __init__(self) -> None:
        self.rewrites = sys.stderr.isatty() or "ipykernel" in sys.modules
        self.width, self.shown = 0, 0.0

    def __call__(self, event: Event) -> None:
        if event.kind in ("step", "clips", "frames"):
            if self.rewrites and (time.monotonic() - self.shown > self.INTERVAL or event.step == event.of):
                self.shown = time.monotonic()
                self._write(_counted(event))
        elif event.kind == "phase":
            self._write(f"{event.phase} ..") if self.rewrites else None
        elif event.kind in ("record", "note") and event.details.get("line"):
            self._stay(f"{event.phase:>9} {event.details['line']}")
        elif event.kind == "begin":
            self._stay(f"run folder {event.details['folder']}, threads {event.details['threads']}")
        elif event.kind in ("wrote", "kept"):
            self._stay(f"{event.kind} {event.details['path']}")

    def end(self) -> None:
        self._write("") if self.rewrites else None

    def _write(self, line: str) -> None:
        print("\r" + line.ljust(self.width), end="\r", file=sys.stderr, flush=True)
        self.width = len(line)

    def _stay(self, line: str) -> None:
        if self.rewrites:
            self._write(line)
            print(file=sys.stderr, flush=True)
            self.width = 0
        else:
            print(line, file=sys.stderr, flush=True)


def _counted(event: Event) -> str:
    line = f"{event.phase or event.kind} {event.step}/{event.of}"
    if event.loss is not None:
        line += f" loss {event.loss:.3f}"
    return line + "".join(f" {name}={value:.3f}" for name, value in event.parameters.items())


def listener(progress: Progress) -> tuple[Callable[[str], object] | None, Callable[[], None]]:
    """What the native module calls, and what is to be called at the end."""
    if progress is False:
        return None, lambda: None
    if progress is True:
        printer = Printer()
        return (lambda text: printer(Event.read(text))), printer.end
    return (lambda text: progress(Event.read(text))), lambda: None

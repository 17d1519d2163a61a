"""Values with intervals, and tables of them for terminals and notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TypeVar

__all__ = ["Parameter", "Table"]


@dataclass(frozen=True)
class Parameter:
    """A physical parameter."""

    value: float
    """In `unit`."""
    interval: tuple[float, float] | None = None
    """95 % interval of a measured video; of generated clips the range of the held-out clips' estimates, two standard
    deviations to either side. `None` where there is none."""
    unit: str = ""
    """Such as `m/s^2`; `px` and `t`, the unit of `dt`, for generated clips; `?` where the equation does not give it."""
    truth: float | None = None
    """The value that the clips were made with, where it is known."""

    @property
    def error_percent(self) -> float | None:
        """Deviation from the truth in per cent of it, with its sign."""
        return 100 * (self.value / self.truth - 1) if self.truth else None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        interval = f" [{_number(self.interval[0])}, {_number(self.interval[1])}]" if self.interval else ""
        return f"{_number(self.value)}{interval}{' ' if self.unit else ''}{self.unit}"

    def cells(self) -> list[str]:
        """Value, interval, unit, truth and error as text."""
        interval = f"{_number(self.interval[0])} to {_number(self.interval[1])}" if self.interval else ""
        error = self.error_percent
        return [
            _number(self.value), interval, self.unit, "" if self.truth is None else _number(self.truth),
            "" if error is None else f"{error:.2f} %"]


def unit_text(powers: Sequence[int] | None, length: str = "px", time: str = "t") -> str:
    """A unit from its powers of length and time: `px/t^2`."""
    if powers is None:
        return "?"
    def part(unit: str, power: int) -> str:
        return unit if abs(power) == 1 else f"{unit}^{abs(power)}"

    parts = list(zip((length, time), powers))
    above = " ".join(part(unit, power) for unit, power in parts if power > 0)
    below = "/".join(part(unit, power) for unit, power in parts if power < 0)
    return (above or "1") + "/" + below if below else above


def _number(value: float) -> str:
    return f"{value:.5g}"


_Value = TypeVar("_Value", bound=Parameter)


class Table(Mapping[str, _Value]):
    """Parameters by name."""

    def __init__(self, parameters: Iterable[tuple[str, _Value]]) -> None:
        self._parameters = dict(parameters)

    def __getitem__(self, name: str) -> _Value:
        return self._parameters[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __repr__(self) -> str:
        return "\n".join(f"{name} = {parameter}" for name, parameter in self.items())

    def _repr_html_(self) -> str:
        heads = ["", "value", "interval", "unit", "truth", "error"]
        return html_table(heads, [[name, *parameter.cells()] for name, parameter in self.items()])


def html_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table without the columns that are empty."""
    used = [place for place in range(len(heads)) if any(row[place] for row in rows)]

    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cells[place])}</{tag}>" for place in used) + "</tr>"

    return "<table>" + line(heads, "th") + "".join(line(row, "td") for row in rows) + "</table>"

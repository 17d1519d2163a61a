"""What a run measures in its own videos."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from .tables import Parameter, Table, html_table

__all__ = ["Measurement"]


@dataclass(frozen=True)
class Measurement:
    """Parameters with 95 % intervals from whole videos, and how well the held-out part is predicted."""

    folder: Path
    """Holds `measurement.html`, `positions.csv`, `overlay.gif`."""
    details: dict[str, Any]
    """All of `measurement.json`."""

    @property
    def parameters(self) -> Table[Parameter]:
        """Parameters and what the motion shows (period, length, amplitude), in metres where the scale is known, and seconds."""
        return Table((quantity["name"], _parameter(quantity)) for quantity in self.details["quantities"])

    @property
    def held_out_error(self) -> tuple[float, str]:
        """Root mean square distance between prediction and held-out frames, with its unit."""
        held_out = self.details["held_out"]
        return held_out["error"], held_out["unit"]

    @property
    def notes(self) -> list[str]:
        """What should be known before the numbers are used."""
        return list(self.details["notes"])

    def positions(self) -> list[dict[str, float | str]]:
        """Rows of `positions.csv`: where each object was seen in each frame and where the equation has it; for
        `pandas.DataFrame`."""
        with open(self.folder / "positions.csv", newline="") as file:
            return [{key: _number(value) for key, value in row.items()} for row in csv.DictReader(file)]

    def alternatives(self) -> list[dict[str, Any]]:
        """The equations that were compared: residual, held-out error, AIC, BIC, parameters."""
        return list(self.details["alternatives"])

    def __repr__(self) -> str:
        return repr(self.parameters)

    def _repr_html_(self) -> str:
        error, unit = self.held_out_error
        notes = "".join(f"<li>{escape(note)}</li>" for note in self.notes)
        compared = ""
        if self.alternatives():
            heads = ["equation", "residual", "held-out error", "AIC", "BIC"]
            keys = ["residual", "held_out_error", "aic", "bic"]
            rows = [[a["equation"], *(f"{a[key]:.4g}" for key in keys)] for a in self.alternatives()]
            compared = html_table(heads, rows)
        return f"{self.parameters._repr_html_()}<p>held-out error {error:.3g} {escape(unit)}</p>{compared}<ul>{notes}</ul>"


def _parameter(quantity: dict[str, Any]) -> Parameter:
    low, high = quantity.get("low"), quantity.get("high")
    interval = (low, high) if low is not None and high is not None else None
    return Parameter(quantity["value"], interval, quantity["unit"])


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text

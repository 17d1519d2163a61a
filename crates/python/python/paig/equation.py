"""Equations of motion as text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, Literal

from ._native import native

__all__ = ["Equation"]

ParameterSettings = Mapping[str, Any]


class Equation:
    """Accelerations in a small language (docs/equations.md) and the parameters that they name.

    A damped spring that pulls to a point::

        Equation("-k * (p - vec(x0, y0)) - b * v",
                 parameters={"k": {"unit": (0, -2)}, "b": {"unit": (0, -1)}, "x0": {"unit": (1, 0)}, "y0": {"unit": (1, 0)}})

    Positions `p` are pixels with y down, the unit of time is that of `dt`.
    """

    def __init__(
        self,
        acceleration: str | Sequence[str],
        parameters: Mapping[str, ParameterSettings] | Iterable[str] = (),
        *,
        objects: int = 1,
        where: Mapping[str, str] | None = None,
        state: Literal["position", "angle"] = "position",
        integrator: Literal["euler", "verlet", "rk4"] = "euler",
        substeps: int = 5,
        walls: bool | Mapping[str, float | str] = False,
        restitution: float | str | None = None,
    ) -> None:
        """Read and check an equation.

        Args:
            acceleration: One text for all objects, or one for each.
            parameters: Their names, or for each a table with `unit` (powers of length and time), `start`, `low`, `high`,
                `fixed`, `each`. Without bounds a parameter is positive.
            objects: How many objects it is for.
            where: Names for parts of the accelerations, each with its text.
            state: `position` (pixels), or `angle` about the frame's middle (radians; 0 is up, positive is clockwise).
            integrator: `euler` is semi-implicit.
            substeps: Steps for a frame, 1 to 1000.
            walls: Whether objects are turned back at the frame's edges, or the places of some of `left`, `right`, `top`,
                `bottom` (pixels, or the name of a parameter).
            restitution: What is left of the speed towards a wall: 0 to 1, or the name of a parameter.

        Raises:
            paig.errors.InputError: A text that is no equation; the message shows the place.
        """
        given: Mapping[str, ParameterSettings]
        given = parameters if isinstance(parameters, Mapping) else {name: {} for name in parameters}
        table: dict[str, Any] = {
            "acceleration": acceleration if isinstance(acceleration, str) else list(acceleration),
            "state": state, "integrator": integrator, "substeps": substeps,
            "walls": dict(walls) if isinstance(walls, Mapping) else walls,
            "parameters": {name: dict(settings) for name, settings in given.items()},
        }
        if where:
            table["where"] = dict(where)
        if restitution is not None:
            table["restitution"] = restitution
        self.objects = objects
        self.table: dict[str, Any] = table
        self.parameters: list[str] = native.check_equation(json.dumps({"equation": table, "objects": objects}))

    @classmethod
    def of_task(cls, task: str) -> Equation:
        """The equation of a task, by its name or file; its text where it has one."""
        system = json.loads(native.task(str(task)))["system"]
        equation = cls.__new__(cls)
        equation.objects, equation.table = system["objects"], system["equation"]
        equation.parameters = native.check_equation(
            json.dumps({"equation": system["equation"], "objects": system["objects"]}))
        return equation

    @property
    def text(self) -> str:
        """The accelerations, one line for each."""
        if isinstance(self.table, str):
            return self.table
        acceleration = self.table["acceleration"]
        return acceleration if isinstance(acceleration, str) else "\n".join(acceleration)

    def __repr__(self) -> str:
        return f"Equation({self.text!r}, parameters={self.parameters}, objects={self.objects})"

    def _repr_html_(self) -> str:
        return f"<code>{escape(self.text)}</code> with {escape(', '.join(self.parameters))}"


def entry(equation: Equation | str) -> Any:
    """An equation as a task file has it: its table, or the name of a built-in one."""
    return equation.table if isinstance(equation, Equation) else equation

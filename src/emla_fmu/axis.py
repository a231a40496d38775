"""Actuators as axes of a machine: plants with what an axis has beside its actuator."""

from typing import Any

from fmublock import DefaultExperiment, Output, Parameter

from . import stroke_load
from .compliant_plant import EmlaCompliantPlant
from .plant import EmlaPlant


class _StrokeLoad:
    """Variables of a load along the stroke."""

    position = Parameter(
        0.0,
        shape=stroke_load.POINTS,
        unit="m",
        name="load.table.position",
        symbol="p_i",
        description="Position of a point of the load along the stroke; fill up with the last one",
    )
    force = Parameter(
        0.0,
        shape=stroke_load.POINTS,
        unit="N",
        name="load.table.force",
        symbol="f_i",
        description="Load force there, in addition to F_L; fill up with the last one",
    )
    interpolation = Parameter(
        stroke_load.LINEAR,
        minimum=stroke_load.HELD,
        maximum=stroke_load.SMOOTH,
        name="load.table.interpolation",
        symbol="",
        description="Force between two points: 0 that of the last point, 1 linear, 2 a smooth curve",
    )
    F_load = Output(
        unit="N",
        nominal=1e4,
        name="load.force",
        symbol="F",
        description="Whole load force: F_L, and that along the stroke",
    )


class EmlaAxis(_StrokeLoad, EmlaPlant):
    """An `EmlaPlant` whose load force also depends on its position, as levers make it.

    The force along the stroke is a table of points, added to F_L. It is that of each instant, not of a
    communication step. Without a table, this is an `EmlaPlant`.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require positions in increasing order."""
        return stroke_load.ordered(v.position)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return those of the `EmlaPlant`, and the whole load force."""
        return {**super().outputs(v), "F_load": self.load_force(v)}

    def load_force(self, v: Any) -> Any:
        """Return F_L and the force along the stroke in N."""
        return v.F_L + stroke_load.force_at(v.x_L, v.position, v.force, v.interpolation)


class EmlaCompliantAxis(_StrokeLoad, EmlaCompliantPlant):
    """An `EmlaCompliantPlant` whose load force also depends on the position of the load.

    The force along the stroke is that of an `EmlaAxis`, at the position of the load instead of the screw.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require positions in increasing order."""
        return stroke_load.ordered(v.position)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return those of the `EmlaCompliantPlant`, and the whole load force."""
        return {**super().outputs(v), "F_load": self.load_force(v)}

    def load_force(self, v: Any) -> Any:
        """Return F_L and the force along the stroke in N."""
        x_load = v.x_L - v.deflection
        return v.F_L + stroke_load.force_at(x_load, v.position, v.force, v.interpolation)

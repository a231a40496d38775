"""Actuators as axes of a machine: plants with what an axis has beside its actuator."""

from typing import Any

from fmublock import Block, DefaultExperiment, Input, Output, Parameter, State

from . import brake, stroke_load
from .compliant_plant import EmlaCompliantPlant
from .plant import EmlaPlant


class _Axis(Block):
    """Variables of a load along the stroke, and of a holding brake."""

    engaged = Input(
        name="brake.engaged",
        symbol="",
        description="1 closes the holding brake, 0 releases it",
        terminal="hold",
    )
    disabled = Input(
        name="inverter.disabled",
        symbol="",
        description="1 switches the inverter off; currents decay",
        terminal="hold",
    )

    brake_torque = Parameter(
        0.0,
        unit="N.m",
        minimum=0.0,
        name="brake.torque",
        symbol=r"\tau_B",
        description="Torque at the motor up to which the brake holds; 0 is no brake",
    )
    brake_frequency = Parameter(
        100.0,
        unit="Hz",
        minimum=1e-3,
        name="brake.frequency",
        symbol="f_B",
        description="Frequency of the inertia at the motor on the closed brake (assumed)",
    )
    brake_damping_ratio = Parameter(
        0.2,
        minimum=0.0,
        name="brake.damping_ratio",
        symbol=r"\zeta_B",
        description="Damping ratio of that motion (assumed)",
    )

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
    brake_angle = State(
        0.0,
        unit="rad",
        nominal=1e-2,
        name="brake.angle",
        symbol=r"\varphi_B",
        description="Elastic angle of the brake",
    )
    slip = State(
        0.0,
        unit="m",
        nominal=1e-3,
        name="brake.slip",
        symbol="s_B",
        description="Travel of the screw while the closed brake slipped, in both directions",
    )

    tau_brake = Output(
        unit="N.m",
        nominal=10.0,
        name="brake.tau",
        symbol="",
        description="Torque of the brake, positive against extension",
    )
    F_load = Output(
        unit="N",
        nominal=1e4,
        name="load.force",
        symbol="F",
        description="Whole load force: F_L, and that along the stroke",
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require positions in increasing order, and a brake that is not too stiff."""
        return {**super().conditions(v), **stroke_load.ordered(v.position), **brake.conditions(v)}

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return those of the plant with its brake."""
        return brake.derivatives(v, super().derivatives(v))

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return those of the plant with its brake, and the whole load force."""
        return {**brake.outputs(v, super().outputs(v)), "F_load": self.load_force(v)}

    def load_force(self, v: Any) -> Any:
        """Return F_L and the force along the stroke in N."""
        raise NotImplementedError


class EmlaAxis(_Axis, EmlaPlant):
    """An `EmlaPlant` with a load force that depends on its position, as levers make it, and a holding brake.

    The force along the stroke is a table of points, added to F_L. It is that of each instant, not of a
    communication step. The brake is at the motor shaft: elastic up to its torque, then it slips. Without a
    table and a brake, this is an `EmlaPlant`.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    def load_force(self, v: Any) -> Any:
        """Return F_L and the force along the stroke in N."""
        return v.F_L + stroke_load.force_at(v.x_L, v.position, v.force, v.interpolation)


class EmlaCompliantAxis(_Axis, EmlaCompliantPlant):
    """An `EmlaCompliantPlant` with a load force that depends on the load's position, and a holding brake.

    Both are those of an `EmlaAxis`; the force is at the position of the load instead of the screw.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)

    def load_force(self, v: Any) -> Any:
        """Return F_L and the force along the stroke in N."""
        x_load = v.x_L - v.deflection
        return v.F_L + stroke_load.force_at(x_load, v.position, v.force, v.interpolation)

"""The commanded motion of the screw, from the wanted motion of a load that is not rigid."""

import math
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    StartTime,
    State,
    clamp,
    maximum,
    minimum,
    sign,
    sqrt,
    where,
)

from . import notch
from .held_inputs import has_begun, interpolated

NOTCHES = 2
"""Number of frequencies that the wanted motion can avoid."""

_PEAK_ACCELERATION = 2520.0 * (3.0 / 14.0) ** 3 / math.sqrt(7.0)
"""Peak of the second derivative of the approach, at r = (1 - sqrt(1/7)) / 2."""


class ScrewCommand(Block):
    """Commands the screw so that the load, behind a spring, makes the wanted motion.

    Four parts, each of which is off by default:

    - Notches: the wanted motion x_d passes filters that remove up to two frequencies, and becomes x_s. So it
      does not excite what swings with these frequencies. Each notch delays the motion by
      2 (1 - zeta) / (pi f).
    - Approach: from where the load is at the start to x_s, on a polynomial of degree 9 whose first four
      derivatives are 0 at both ends. It waits where the wanted motion needs the speed. The planned motion of
      the load is x_p.
    - Deflection: the screw is ahead of the load by the spring's deflection under the load force F_hat and the
      load's inertia, (F_hat + m a_p) / k, and by half the play in the direction of F_hat. A wrong F_hat moves
      the load by its error over k.
    - Feedback of a measured load: z integrates position, speed and acceleration errors of the load. Its
      position, speed and acceleration come from a `LoadObserver`.

    The first three do not feed anything back, so that the margins of the controller's loops stay.

    The start is that of the first step: x_d, x_1 and F_hat need their values by then. Load and wanted motion
    are at rest there.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-4)
    has_model_exchange = False  # the values of the start are sampled

    x_d = Input(unit="m", nominal=0.1, description="Wanted load position", terminal="reference")
    v_d = Input(unit="m/s", nominal=0.1, description="Wanted load speed", terminal="reference")
    a_d = Input(unit="m/s2", description="Wanted load acceleration", terminal="reference")
    x_1 = Input(
        unit="m",
        nominal=0.1,
        description="Measured screw position; only its first value is used",
        terminal="sensor.x_measured",
    )
    F_hat = Input(
        unit="N",
        nominal=1e4,
        symbol=r"\hat{F}",
        description="Assumed load force, positive against extension",
        terminal="load_estimate.F_0",
    )
    x_load = Input(
        unit="m",
        nominal=0.1,
        name="load.x",
        symbol=r"\hat{x}_m",
        description="Estimated load position",
        terminal="load_estimate.x_hat",
    )
    v_load = Input(
        unit="m/s",
        nominal=0.1,
        name="load.v",
        symbol=r"\hat{v}_m",
        description="Estimated load speed",
        terminal="load_estimate.v_hat",
    )
    a_load = Input(
        unit="m/s2",
        name="load.a",
        symbol=r"\hat{a}_m",
        description="Estimated load acceleration",
        terminal="load_estimate.a_hat",
    )

    stiffness = Parameter(
        0.0,
        unit="N/m",
        minimum=0.0,
        name="model.stiffness",
        symbol="k",
        description="Stiffness between screw and load; 0 is a rigid load",
    )
    m_load = Parameter(
        0.0, unit="kg", minimum=0.0, name="model.m_load", symbol="m", description="Mass of the load"
    )
    backlash = Parameter(
        0.0,
        unit="m",
        minimum=0.0,
        name="model.backlash",
        symbol="b",
        description="Play between screw and load, from one contact to the other",
    )
    approach_time = Parameter(
        0.0,
        unit="s",
        minimum=0.0,
        name="approach.duration",
        symbol="T_a",
        description="Shortest duration of the approach; 0 is no approach",
    )
    approach_acceleration = Parameter(
        0.5,
        unit="m/s2",
        minimum=1e-6,
        name="approach.a_max",
        symbol="a_a",
        description="Largest acceleration of the approach, relative to the wanted motion",
    )
    v_max = Parameter(
        0.1,
        unit="m/s",
        minimum=1e-6,
        name="limit.v_max",
        description="Largest speed of wanted motion and approach together, and of the deflection",
    )
    frequency = Parameter(
        0.0,
        shape=NOTCHES,
        unit="Hz",
        minimum=0.0,
        name="notch.frequency",
        symbol="f_i",
        description="Frequency that the wanted motion avoids; 0 is none",
    )
    damping_ratio = Parameter(
        0.0,
        shape=NOTCHES,
        minimum=0.0,
        maximum=0.9,
        name="notch.damping_ratio",
        symbol=r"\zeta_i",
        description="Damping ratio of what swings with this frequency",
    )
    k_0 = Parameter(0.0, unit="1/s", name="feedback.k_0", description="Gain on the load's position error")
    k_1 = Parameter(0.0, name="feedback.k_1", description="Gain on the load's speed error")
    k_2 = Parameter(0.0, unit="s", name="feedback.k_2", description="Gain on the load's acceleration error")
    z_max = Parameter(
        0.01,
        unit="m",
        minimum=0.0,
        name="feedback.limit",
        symbol=r"z_{max}",
        description="Largest correction by the feedback",
    )
    interpolate = Parameter(True, description="Interpolate x_d linearly during a step, for the notches")

    p = State(
        0.0,
        shape=NOTCHES * notch.ORDER,
        unit="m",
        nominal=0.1,
        name="notch.p",
        symbol="p_j",
        description="Lags of the notches, from the first wanted position",
    )

    z = DiscreteState(
        0.0, unit="m", nominal=1e-3, name="feedback.z", description="Correction of the screw by the feedback"
    )
    progress = DiscreteState(
        0.0, name="approach.progress", symbol="r", description="Progress of the approach, from 0 to 1"
    )
    x_d_start = DiscreteState(0.0, unit="m", name="start.x_d", description="First wanted load position")
    gap_start = DiscreteState(
        0.0,
        unit="m",
        name="start.gap",
        symbol=r"\Delta_0",
        description="Load position minus wanted load position at the start",
    )
    deflection_before = DiscreteState(
        0.0,
        unit="m",
        name="before.deflection",
        symbol=r"\delta_-",
        description="Deflection at the last step's end",
    )
    deflection_rate = DiscreteState(
        0.0, unit="m/s", name="before.deflection_rate", description="Rate of the deflection in the last step"
    )
    x_d_before = DiscreteState(
        0.0,
        unit="m",
        name="before.x_d",
        symbol="x_{d,-}",
        description="Wanted load position in the last step",
    )
    t_before = StartTime(0.0, unit="s", name="before.time", symbol="t_-", description="The last step's end")
    h_before = DiscreteState(
        0.0, unit="s", name="before.step", symbol="h_-", description="The last step's length"
    )

    x_c = Output(unit="m", nominal=0.1, description="Commanded screw position", terminal="command.x_d")
    v_c = Output(unit="m/s", nominal=0.1, description="Commanded screw speed", terminal="command.v_d")
    a_c = Output(unit="m/s2", description="Commanded screw acceleration", terminal="command.a_d")
    x_s = Output(unit="m", nominal=0.1, description="Wanted load position after the notches")
    v_s = Output(unit="m/s", nominal=0.1, description="Wanted load speed after the notches")
    a_s = Output(unit="m/s2", description="Wanted load acceleration after the notches")
    deflection = Output(
        unit="m", nominal=1e-3, symbol=r"\delta", description="Expected deflection under F_hat and inertia"
    )
    correction = Output(unit="m", nominal=1e-3, description="Correction of the screw by the feedback")

    def conditions(self, v: Any) -> dict[str, Any]:
        """Refuse notches that are too fast for the internal step, with which their lags would be wrong."""
        largest_angle = 2.0 * math.pi * maximum(*v.frequency) * v.internal_step
        return {"2 pi notch.frequency solver.internal_step must be at most 1": largest_angle <= 1.0}

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return those of the notches, of a wanted position that moves during a step."""
        x, lag_rates = interpolated(v, v.x_d, v.x_d_before) - self.first_wanted(v), list[Any]()
        for p, frequency, zeta in self.notches(v):
            lag_rates += notch.rates(p, x, frequency)
            x = notch.filtered(p, x, frequency, zeta)
        return {"p": lag_rates}

    def update(self, v: Any) -> dict[str, Any]:
        """Return the correction, what the run started with, and what the next step needs of this one."""
        shaped, step = self.shaped(v), v.time - v.t_before
        r = minimum(v.progress + step * self.approach(v, shaped, v.progress)[2], 1.0)
        planned = self.planned(v, shaped, r)
        deflection = self.expected_deflection(v, planned[2])
        change = deflection - v.deflection_before
        # unknown before the first step, in which the deflection at its beginning is not kept
        change = where(has_begun(v), clamp(change, -v.v_max * step, v.v_max * step), 0.0)
        return {
            "z": clamp(v.z + step * self.correction_rate(v, planned), -v.z_max, v.z_max),
            "progress": r,
            "x_d_start": self.first_wanted(v),
            "gap_start": self.gap(v),
            "deflection_before": where(has_begun(v), v.deflection_before + change, deflection),
            "deflection_rate": change / maximum(step, 1e-12),
            "x_d_before": v.x_d,
            "t_before": v.time,
            "h_before": step,
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the commanded motion of the screw, and the wanted motion of the load after the notches."""
        x_s, v_s, a_s = self.shaped(v)
        x_p, v_p, a_p = self.planned(v, (x_s, v_s, a_s), v.progress)
        deflection = where(has_begun(v), v.deflection_before, self.expected_deflection(v, a_p))
        play = 0.5 * v.backlash * sign(v.F_hat)
        z_rate = where(abs(v.z) < v.z_max, self.correction_rate(v, (x_p, v_p, a_p)), 0.0)
        return {
            "x_c": x_p + deflection + play + v.z,
            "v_c": v_p + v.deflection_rate + z_rate,
            "a_c": a_p,
            "x_s": x_s,
            "v_s": v_s,
            "a_s": a_s,
            "deflection": deflection,
            "correction": v.z,
        }

    def notches(self, v: Any) -> list[tuple[Any, Any, Any]]:
        """Return lags in m, frequency in Hz and damping ratio of each notch, in the order of the signal."""
        lags = [v.p[i : i + notch.ORDER] for i in range(0, NOTCHES * notch.ORDER, notch.ORDER)]
        return list(zip(lags, v.frequency, v.damping_ratio, strict=True))

    def first_wanted(self, v: Any) -> Any:
        """Return the first wanted position in m."""
        return where(has_begun(v), v.x_d_start, v.x_d)

    def shaped(self, v: Any) -> tuple[Any, Any, Any]:
        """Return the wanted motion after the notches: m, m/s, m/s2."""
        x = wanted = v.x_d - self.first_wanted(v)
        speed, acceleration = v.v_d, v.a_d
        for p, frequency, zeta in self.notches(v):
            rates = notch.rates(p, x, frequency)
            second_rates = notch.rates(rates, speed, frequency)
            x = notch.filtered(p, x, frequency, zeta)
            speed = notch.filtered(rates, speed, frequency, zeta)
            acceleration = notch.filtered(second_rates, acceleration, frequency, zeta)
        return v.x_d + (x - wanted), speed, acceleration  # the bits of x_d without notches

    def gap(self, v: Any) -> Any:
        """Return the load's position minus the wanted one at the start, in m, if the load was at rest.

        It is 0 without an approach.
        """
        at_rest = self.expected_deflection(v, 0.0) + 0.5 * v.backlash * sign(v.F_hat)
        gap = where(v.approach_time > 0.0, v.x_1 - at_rest - v.x_d, 0.0)
        return where(has_begun(v), v.gap_start, gap)

    def approach_duration(self, v: Any) -> Any:
        """Return the duration of the approach in s, if nothing limits its speed."""
        size = maximum(abs(self.gap(v)), 1e-12)  # above 0, where the square root has no derivative
        return maximum(v.approach_time, sqrt(_PEAK_ACCELERATION * size / v.approach_acceleration))

    def approach(self, v: Any, shaped: tuple[Any, Any, Any], r: Any) -> tuple[Any, Any, Any]:
        """Return speed in m/s and acceleration in m/s2 of the approach, and the rate of its progress in 1/s.

        The speed is the one that the progress r needs in the duration T, or what the wanted motion leaves of
        the largest speed, if that is less. Between both it changes smoothly, (needed^-4 + left^-4)^(-1/4), so
        that the acceleration jumps only where the wanted motion alone begins to need all the speed.
        """
        gap, T, q = self.gap(v), self.approach_duration(v), r * (1.0 - r)
        direction = -sign(gap)
        needed = abs(gap) * 630.0 * q * q * q * q / T
        spare = v.v_max - direction * shaped[1]
        waits, left = spare <= 0.0, maximum(spare, 1e-9)
        ratio = needed / left
        power = 1.0 + ratio * ratio * ratio * ratio
        root = sqrt(sqrt(power))
        of_needed = abs(gap) * 2520.0 * q * q * q * (1.0 - 2.0 * r) / (T * T * root)
        of_left = -direction * shaped[2]
        slope = (of_needed + ratio * ratio * ratio * ratio * ratio * of_left) / (power * root)
        return (
            where(waits, 0.0, direction * needed / root),
            where(waits, 0.0, direction * slope),
            where(waits, 0.0, 1.0 / (T * root)),
        )

    def planned(self, v: Any, shaped: tuple[Any, Any, Any], r: Any) -> tuple[Any, Any, Any]:
        """Return the planned motion of the load in m, m/s, m/s2: the wanted one, and the approach to it.

        Args:
            v: Values of the block.
            shaped: The wanted motion after the notches.
            r: The progress of the approach.
        """
        x_s, v_s, a_s = shaped
        speed, acceleration, _ = self.approach(v, shaped, r)
        s = r * r * r * r * r * (126.0 + r * (-420.0 + r * (540.0 + r * (-315.0 + r * 70.0))))
        return x_s + self.gap(v) * (1.0 - s), v_s + speed, a_s + acceleration

    def expected_deflection(self, v: Any, acceleration: Any) -> Any:
        """Return the deflection in m under the load force and the load's inertia at m/s2."""
        is_rigid = v.stiffness <= 0.0
        return where(is_rigid, 0.0, (v.F_hat + v.m_load * acceleration) / where(is_rigid, 1.0, v.stiffness))

    def correction_rate(self, v: Any, planned: tuple[Any, Any, Any]) -> Any:
        """Return the rate of the feedback's correction in m/s, for the planned motion of the load."""
        x_p, v_p, a_p = planned
        return v.k_0 * (x_p - v.x_load) + v.k_1 * (v_p - v.v_load) + v.k_2 * (a_p - v.a_load)

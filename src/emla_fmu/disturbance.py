"""Load force and disturbances of torque and voltage that act on a joint."""

import math
from collections.abc import Callable
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    arctan,
    clamp,
    cos,
    exp,
    floor,
    logical_and,
    maximum,
    sin,
    where,
)
from fmublock.noise import lehmer, uniform

from .schedule import NEVER

LEVELS = 6
"""Number of levels of a load profile."""


class Disturbance(Block):
    """Load force profile and the disturbances (82) and (83) of one joint.

    d_2 is a sum of sines, a decaying arctan of the speed, and a uniform random value held for a
    sample time. The paper says that (82) is in newtons, but uses it as an acceleration in (26). As a force,
    it is subtracted from F_L. Positive values push the actuator out in both cases.
    """

    default_experiment = DefaultExperiment(stop_time=10.0, step_size=1e-4)

    v_L = Input(unit="m/s", nominal=0.1, description="Screw speed, for the arctan term", terminal="load")

    level = Parameter(
        0.0, shape=LEVELS, unit="N", name="load.level", symbol="F_i", description="Load force level"
    )
    level_start = Parameter(
        NEVER,
        shape=LEVELS,
        unit="s",
        name="load.start",
        symbol="t_i",
        description="Time at which a level begins; the first level holds from the beginning",
    )
    ramp = Parameter(
        0.5,
        unit="s",
        minimum=1e-6,
        name="load.ramp",
        symbol="T_r",
        description="Time from one load level to the next",
    )
    ripple = Parameter(
        0.0, unit="N", minimum=0.0, name="load.ripple", symbol="w", description="Width of the load's ripple"
    )
    ripple_omega = Parameter(
        2.0 * math.pi,
        unit="rad/s",
        name="load.ripple_omega",
        symbol=r"\omega_r",
        description="Angular frequency of the ripple",
    )
    is_force = Parameter(
        False, name="d_2.is_force", description="Whether d_2 is a force in N, not an acceleration in m/s2"
    )
    amplitude_2 = Parameter(
        0.0,
        shape=2,
        unit="m/s2",
        name="d_2.amplitude",
        symbol="a_{2,i}",
        description="Amplitudes of the sines (in N if a force)",
    )
    omega_2 = Parameter(0.0, shape=2, unit="rad/s", name="d_2.omega", description="Their angular frequencies")
    phase_2 = Parameter(
        0.0, shape=2, unit="rad", name="d_2.phase", symbol=r"\varphi_{2,i}", description="Their phases"
    )
    arctan_2 = Parameter(
        0.0, unit="m/s2", name="d_2.arctan", symbol="c", description="Factor of arctan(v_L / (1 m/s))"
    )
    decay_2 = Parameter(
        0.0,
        unit="1/s",
        minimum=0.0,
        name="d_2.decay",
        symbol=r"\lambda",
        description="Decay of the arctan term",
    )
    low_2 = Parameter(
        0.0, unit="m/s2", name="d_2.low", symbol="b_{low}", description="Lower end of the random value"
    )
    high_2 = Parameter(
        0.0, unit="m/s2", name="d_2.high", symbol="b_{high}", description="Upper end of the random value"
    )
    sample_time = Parameter(
        1e-4,
        unit="s",
        minimum=1e-9,
        name="d_2.sample_time",
        symbol="T_d",
        description="Time for which a random value is held",
    )
    seed = Parameter(
        1690412731, minimum=1, maximum=2147483646, name="d_2.seed", description="Start of the random sequence"
    )
    amplitude_3 = Parameter(
        0.0,
        shape=2,
        unit="V",
        name="d_3.amplitude",
        symbol="a_{3,i}",
        description="Amplitudes of the cosines in d_3",
    )
    omega_3 = Parameter(0.0, shape=2, unit="rad/s", name="d_3.omega", description="Their angular frequencies")
    phase_3 = Parameter(
        0.0, shape=2, unit="rad", name="d_3.phase", symbol=r"\varphi_{3,i}", description="Their phases"
    )
    amplitude_4 = Parameter(
        0.0, unit="V", name="d_4.amplitude", symbol="a_4", description="Amplitude of the cosine d_4"
    )
    omega_4 = Parameter(0.0, unit="rad/s", name="d_4.omega", description="Its angular frequency")
    phase_4 = Parameter(0.0, unit="rad", name="d_4.phase", symbol=r"\varphi_4", description="Its phase")

    sag_depth = Parameter(
        0.0,
        minimum=0.0,
        maximum=0.99,
        name="supply.depth",
        symbol="D",
        description="Fraction of the supply voltage by which a sag lowers it",
    )
    sag_start = Parameter(
        NEVER, unit="s", name="supply.start", symbol="t_s", description="Time at which the sag begins"
    )
    sag_duration = Parameter(
        1.0,
        unit="s",
        minimum=0.0,
        name="supply.duration",
        symbol="T_s",
        description="Duration of the sag",
    )

    random = DiscreteState(seed, name="d_2.random", symbol="r", description="State of the random generator")
    sample = DiscreteState(
        0.0, name="d_2.sample", symbol="k", description="Number of the present random value"
    )

    F_L = Output(unit="N", nominal=1e4, description="Load force, positive against extension", terminal="load")
    d_2 = Output(unit="m/s2", description="Disturbance of the screw's acceleration", terminal="load")
    d_3 = Output(unit="V", nominal=10.0, description="Disturbance of the q-axis voltage", terminal="load")
    d_4 = Output(unit="V", nominal=10.0, description="Disturbance of the d-axis voltage", terminal="load")
    sag = Output(
        name="supply.sag",
        symbol=r"\sigma_u",
        description="Missing fraction of the supply voltage",
        terminal="load",
    )

    def update(self, v: Any) -> dict[str, Any]:
        """Draw a random value after each sample time, at most one per communication step.

        Samples count from t = 0. A run that starts earlier holds the first value until the end of
        the first sample, so that from t = 0 on its values are those of all other runs.
        """
        sample = floor(v.time / v.sample_time + 1e-6)
        return {
            "random": where(sample > v.sample, lehmer(v.random), v.random),
            "sample": maximum(sample, v.sample),
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the load force, (82) and (83) at the present time."""
        d_2 = self.acceleration_disturbance(v)
        as_force = where(v.is_force, 1.0, 0.0)
        d_3 = 0.0
        for i in range(2):
            d_3 += wave(v.amplitude_3[i], cos, v.omega_3[i] * v.time + v.phase_3[i])
        return {
            "F_L": self.load(v) - as_force * d_2,
            "d_2": (1.0 - as_force) * d_2,
            "d_3": d_3,
            "d_4": wave(v.amplitude_4, cos, v.omega_4 * v.time + v.phase_4),
            "sag": self.sag_of_supply(v),
        }

    def load(self, v: Any) -> Any:
        """Return the load force in N: ramps from level to level, with a ripple."""
        force = v.level[0]
        for i in range(1, LEVELS):
            risen = clamp((v.time - v.level_start[i]) / v.ramp, 0.0, 1.0)
            force += (v.level[i] - v.level[i - 1]) * risen
        return force + wave(0.5 * v.ripple, sin, v.ripple_omega * v.time)

    def sag_of_supply(self, v: Any) -> Any:
        """Return the missing fraction of the supply voltage: a rectangle in time."""
        lasts = logical_and(v.time >= v.sag_start, v.time < v.sag_start + v.sag_duration)
        return where(lasts, v.sag_depth, 0.0)

    def acceleration_disturbance(self, v: Any) -> Any:
        """Return (82) in m/s2, or in N if it is read as a force."""
        decaying = v.arctan_2 * arctan(v.v_L) * exp(-v.decay_2 * v.time)
        d_2 = where(v.arctan_2 == 0.0, 0.0, decaying)
        for i in range(2):
            d_2 += wave(v.amplitude_2[i], sin, v.omega_2[i] * v.time + v.phase_2[i])
        return d_2 + v.low_2 + (v.high_2 - v.low_2) * uniform(v.random)


def wave(amplitude: Any, shape: Callable[[Any], Any], angle: Any) -> Any:
    """Return a sine or cosine of an angle in rad; it is not computed if the amplitude is 0."""
    return where(amplitude == 0.0, 0.0, amplitude * shape(angle))

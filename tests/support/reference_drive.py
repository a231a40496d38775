"""What a drive has beside the paper's plant, written a second time: part of what the tests compare against.

Nothing here is taken from the blocks. All quantities are in SI units; a value of zero switches an
effect off, as None does for one with several numbers. What is random is not here.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class DeadTime:
    """A leg loses `seconds` of U_dc per period of 1 / `frequency`, against its current."""

    seconds: float
    frequency: float
    i_0: float

    def lost(self, current: float, U_dc: float) -> float:
        """Mean voltage of a leg with this current."""
        return -self.seconds * self.frequency * U_dc * current / math.hypot(current, self.i_0)


@dataclass(frozen=True)
class Friction:
    """Coulomb and Stribeck friction in N."""

    F_C: float
    F_S: float
    v_S: float

    def force(self, v: float, v_0: float) -> float:
        """Against the speed, so of its sign."""
        excess = (self.F_S - self.F_C) * self.v_S**2 / (self.v_S**2 + v**2)
        return smooth_sign(v, v_0) * (self.F_C + excess)


@dataclass(frozen=True)
class EndStops:
    """Hunt and Crossley with an exponent of 2, never pulling."""

    low: float
    high: float
    k: float
    c: float

    def force(self, x: float, v: float) -> float:
        """On the screw, positive where it pushes the actuator out."""
        if x < self.low:
            return self._of_one(self.low - x, -v)
        return -self._of_one(x - self.high, v) if x > self.high else 0.0

    def _of_one(self, depth: float, approach: float) -> float:
        z = self.c * approach
        return self.k * depth**2 * (1.0 + z if z > 0.0 else 1.0 / (1.0 - z))


@dataclass(frozen=True)
class Winding:
    """One body with a thermal resistance and a heat capacity."""

    i_N: float
    permitted_rise: float
    time_constant: float
    alpha_R: float = 0.0
    """Growth of the resistance in 1/K."""

    def load(self, i_q: float, i_d: float) -> float:
        return (i_q**2 + i_d**2) / self.i_N**2

    def rate(self, i_q: float, i_d: float, rise: float, R_s: float) -> float:
        """K/s."""
        resistance = self.permitted_rise / (1.5 * R_s * self.i_N**2)
        capacity = self.time_constant / resistance
        return (1.5 * R_s * (i_q**2 + i_d**2) - rise / resistance) / capacity


@dataclass(frozen=True)
class Cogging:
    """Torque in N m that repeats so many times in a turn of the motor."""

    amplitude: float
    periods: int

    def torque(self, turns: float) -> float:
        return self.amplitude * math.sin(2.0 * math.pi * self.periods * turns)


@dataclass(frozen=True)
class MotorEncoder:
    """An eccentric encoder behind a screw of another lead: an angle in rad, a fraction, and a length in m."""

    eccentricity: float
    lead_error: float
    wobble: float

    def reads(self, x: float, motor_turns: float, lead: float) -> float:
        """The position in m that the drive computes from the angle with the nominal lead."""
        travelled_too_far = self.lead_error * x + self.wobble * math.sin(2.0 * math.pi * x / lead)
        turns_read = motor_turns + self.eccentricity * math.sin(2.0 * math.pi * motor_turns) / (2.0 * math.pi)
        return x * turns_read / motor_turns - travelled_too_far


@dataclass(frozen=True)
class Transmission:
    """What is between the screw and a load of the mass m; b is the whole play."""

    m: float
    k: float
    c: float
    b: float

    def force(self, deflection: float, speed: float) -> float:
        """On the load, positive where the screw pushes."""
        if self.b == 0.0:
            return self.k * deflection + self.c * speed
        if deflection < 0.0:  # the other contact is its mirror image
            return -self.force(-deflection, -speed)
        depth = deflection - self.b / 2.0
        if depth <= 0.0:
            return 0.0
        c = self.c if depth > self.b / 2.0 else self.c * depth / (self.b / 2.0)
        return max(self.k * depth + c * speed, 0.0)


@dataclass(frozen=True)
class Drive:
    """All effects, each off unless given."""

    dead_time: DeadTime | None = None
    friction: Friction | None = None
    end_stops: EndStops | None = None
    winding: Winding | None = None
    eta_back: float | None = None
    """Efficiency where the load drives; None leaves D_eq as printed."""
    v_0: float = 1e-4
    cogging: Cogging | None = None
    encoder: MotorEncoder | None = None

    def lost_in_gears(self, F: float, v: float, eta: float) -> float:
        """Force against the motion, by which the motor feels another load than F; of the speed's sign.

        Well above v_0 it is (1 / eta - 1) |F| where the motor drives and (1 - eta_back) |F| where the
        load does. Below, each of the two counts by how sure the direction is.
        """
        if self.eta_back is None:
            return 0.0
        s = smooth_sign(v, self.v_0)
        driving, driven = 1.0 / eta - 1.0, 1.0 - self.eta_back
        sure = s if F > 0.0 else -s
        return abs(F) * s * (0.5 * (1.0 + sure) * driving + 0.5 * (1.0 - sure) * driven)


def smooth_sign(v: float, v_0: float) -> float:
    """From -1 to 1."""
    return v / math.hypot(v, v_0)


NO_DRIVE = Drive()
"""The paper's plant alone."""


@dataclass(frozen=True)
class HoldingBrake:
    """A spring and a damper between shaft and housing, with a slip clutch in series: torque in N m.

    `frequency` in Hz and `zeta` are those of the inertia in kg m2 on the spring.
    """

    limit: float
    frequency: float
    zeta: float
    inertia: float
    released: float = 1e-3
    """Time constant in s with which the spring unwinds after release."""

    @property
    def spring(self) -> float:
        """Stiffness in N m/rad."""
        return self.inertia * (2.0 * math.pi * self.frequency) ** 2

    def torque(self, angle: float, speed: float) -> float:
        """What the closed brake holds against, at a windup in rad and a speed in rad/s."""
        damper = 2.0 * self.zeta * math.sqrt(self.spring * self.inertia)
        return max(-self.limit, min(self.limit, self.spring * angle + damper * speed))

    def slips(self, angle: float, speed: float) -> bool:
        """Whether the clutch slips: the spring has the whole torque, and is wound up further."""
        return self.spring * abs(angle) >= self.limit and angle * speed > 0.0

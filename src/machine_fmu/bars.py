"""Inertia of bars between two points: what their motion requires of their ends.

A bar is slender: its inertia about its axis, and its rotation about it, do not count.
"""

from dataclasses import dataclass
from typing import Any

from .equations import Equation, Numbers
from .exact import ONE, ZERO
from .mechanism import Bar
from .pose import Motion, swing
from .vectors import NONE, Vector, add, cross, dot, is_none, scale, subtract


@dataclass
class BarInertia:
    """Moments of a bar about its start, at its present length.

    Args:
        bar: The bar.
        equation: Its equation in a pose.
    """

    bar: Bar
    equation: Equation

    def __post_init__(self) -> None:
        """Compute the moments: mass, first moment, that of the rod, and inertia."""
        bar = self.bar
        self.m, self.rod_m = bar.m + bar.rod_m, bar.rod_m
        place = self.equation.distance - bar.rod_c
        self.rod_S = bar.rod_m * place
        own = bar.m * bar.c
        self.S = own + self.rod_S
        self.J = own * bar.c + bar.J + self.rod_S * place + bar.rod_J

    def forces(
        self, start: Motion, carrier: Motion, stroke: tuple[Any, Any], rates: Numbers, growths: Numbers
    ) -> tuple[Vector, Vector, Any]:
        """Return the forces in N at both ends, the second one across the bar, and the force along the rod.

        The last one is what the rod needs beside the force at its end, without its acceleration relative to
        the housing, which actuators count.

        Args:
            start: Motion of the frame of the bar's start.
            carrier: Motion of the last common carrier of both ends.
            stroke: Speed and acceleration of the bar's length, m/s and m/s2.
            rates: Speeds of the coordinates.
            growths: Accelerations of the coordinates.
        """
        equation, u = self.equation, self.equation.u
        speed, gain = stroke
        a = start.acceleration_at(equation.pose.reach(self.bar.start))
        omega, alpha = self._turn(carrier, speed, rates, growths)
        squared, twice = dot(omega, omega), speed + speed
        along = self.rod_m * gain - self.S * squared
        across = add(scale(self.S, alpha), scale(self.rod_m * twice, omega))
        force = add(scale(self.m, a), add(scale(along, u), cross(across, u)))
        moment = add(scale(self.S, cross(u, a)), scale(self.J, alpha))
        moment = add(moment, scale(self.rod_S * twice, omega))
        at_end = cross(scale(ONE / equation.distance, moment), u)
        return subtract(force, at_end), at_end, self.rod_m * dot(u, a) - self.rod_S * squared

    def _turn(self, carrier: Motion, speed: Any, rates: Numbers, growths: Numbers) -> tuple[Vector, Vector]:
        """Return angular velocity and acceleration of the bar, without its rotation about its axis."""
        equation, u, L = self.equation, self.equation.u, self.equation.distance
        relative = equation.turning(rates)
        gain = NONE
        for i, turn in equation.turns.items():
            gain = add(gain, scale(growths.get(i, ZERO), turn))
        if not is_none(relative):
            gain = add(gain, equation.acceleration(rates)[1])
        if equation.pose.mechanism.is_plane:
            gain = subtract(gain, scale(speed + speed, relative))
            return add(carrier.omega, relative), add(carrier.alpha, scale(ONE / L, gain))
        about = carrier.omega
        omega = add(relative, subtract(about, scale(dot(u, about), u)))
        reach = scale(L, u)
        v = add(scale(speed, u), scale(L, cross(relative, u)))
        more = add(swing(about, carrier.alpha, reach), scale(2.0, cross(about, v)))
        more = subtract(more, scale(speed + speed, cross(omega, u)))
        return omega, scale(ONE / L, add(gain, cross(u, more)))

"""Commands of the screw and the observer of its load, written independently of the blocks.

Notches are transfer functions, the approach is the polynomial that meets its conditions at both ends, and
states between communication points are those of matrix exponentials.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from scipy import signal
from scipy.linalg import expm

from tests.support.reference_model import Vector

Row = dict[str, float]


@dataclass(frozen=True)
class Linear:
    """x' = A x + B u, y = C x + D u, with one output."""

    A: Vector
    B: Vector
    C: Vector
    D: Vector

    def transition(self, h: float) -> Vector:
        """The matrix by which state, inputs and their slopes give the state h s later, on lines."""
        n, m = self.B.shape
        line = np.block([[np.zeros((m, m)), np.eye(m)], [np.zeros((m, 2 * m))]])
        augmented = np.block([[self.A, self.B, np.zeros((n, m))], [np.zeros((2 * m, n)), line]])
        return expm(augmented * h)[:n]

    def outputs(self, x: Vector, u: Sequence[float]) -> list[float]:
        """The output and its first two derivatives, for one input and its derivatives."""
        first = self.A @ x + self.B[:, 0] * u[0]
        second = self.A @ first + self.B[:, 0] * u[1]
        return [float(self.C @ s + self.D[0] * i) for s, i in zip((x, first, second), u, strict=True)]


def filtered(numerator: Polynomial, poles: int, frequency: float) -> Linear:
    """numerator / (s + 1)^poles, with s relative to 2 pi times the frequency in Hz."""
    A, B, C, D = signal.tf2ss(numerator.coef[::-1], (Polynomial([1.0, 1.0]) ** poles).coef[::-1])
    w = 2.0 * math.pi * frequency
    return Linear(w * A, w * B, C[0], D[0])


def notch(frequency: float, zeta: float) -> Linear:
    """((s^2 + 2 zeta w s + w^2) / (s + w)^2)^2."""
    return filtered(Polynomial([1.0, 2.0 * zeta, 1.0]) ** 2, 4, frequency)


def in_series(first: Linear, second: Linear) -> Linear:
    """The second one filters what the first one gives."""
    n, k = len(first.A), len(second.A)
    return Linear(
        np.block([[first.A, np.zeros((n, k))], [np.outer(second.B, first.C), second.A]]),
        np.vstack([first.B, second.B @ first.D[None, :]]),
        np.concatenate([second.D[0] * first.C, second.C]),
        second.D[0] * first.D,
    )


def smooth_step() -> Polynomial:
    """From 0 to 1 as r goes from 0 to 1, with the first four derivatives 0 at both ends."""
    conditions = [(r, order) for r in (0.0, 1.0) for order in range(5)]
    rows = [
        [Polynomial.basis(n).deriv(order)(r) if order else r**n for n in range(10)] for r, order in conditions
    ]
    values = [1.0 if condition == (1.0, 0) else 0.0 for condition in conditions]
    return Polynomial(np.round(np.linalg.solve(np.array(rows), np.array(values))))  # whole numbers


STEP = smooth_step()


def largest(p: Polynomial) -> float:
    """The largest magnitude between 0 and 1."""
    inner = [float(r.real) for r in p.deriv().roots() if abs(r.imag) < 1e-9 and 0.0 <= r.real <= 1.0]
    return max(abs(float(p(r))) for r in (0.0, 1.0, *inner))


@dataclass(frozen=True)
class Load:
    """What the load is believed to be."""

    k: float
    m: float
    c: float = 0.0
    b: float = 0.0


@dataclass(frozen=True)
class Command:
    """The commands of a screw; `approach` is shortest duration and largest acceleration."""

    load: Load
    approach: tuple[float, float]
    v_max: float
    notches: tuple[tuple[float, float], tuple[float, float]]
    gains: tuple[float, float, float]
    limit: float

    @property
    def filters(self) -> dict[str, Linear]:
        """From the wanted position: to the shaped one, and to each lag by its FMI name."""
        (f_1, zeta_1), (f_2, zeta_2) = self.notches
        first, second = notch(f_1, zeta_1), Polynomial([1.0])
        lags = {f"notch.p[{j}]": filtered(second, j, f_1) for j in (1, 2, 3, 4)}
        lags |= {f"notch.p[{4 + j}]": in_series(first, filtered(second, j, f_2)) for j in (1, 2, 3, 4)}
        return {"x_s": in_series(first, notch(f_2, zeta_2)), **lags}

    def duration(self, gap: float) -> float:
        """How long the approach takes from so far away, if it does not wait."""
        shortest, a_max = self.approach
        return max(shortest, math.sqrt(largest(STEP.deriv(2)) * abs(gap) / a_max))

    def approached(self, gap: float, r: float, shaped: Sequence[float]) -> tuple[list[float], float]:
        """Position, speed and acceleration of the load at a progress r, and the rate of the progress."""
        x_s, v_s, a_s = shaped
        T, direction = self.duration(gap), -math.copysign(1.0, gap)
        x = x_s + gap * (1.0 - float(STEP(r)))
        needed = abs(gap) * float(STEP.deriv()(r)) / T
        remaining = self.v_max - direction * v_s
        if needed == 0.0 or remaining <= 0.0:
            waits = needed > 0.0
            return [x, v_s, a_s if waits or gap == 0.0 else a_s - gap * float(STEP.deriv(2)(r)) / T**2], (
                0.0 if waits else 1.0 / T
            )
        speed = (needed**-4 + remaining**-4) ** -0.25
        share = speed / needed
        slopes = abs(gap) * float(STEP.deriv(2)(r)) / T * share / T, -direction * a_s
        slope = speed**5 * (slopes[0] / needed**5 + slopes[1] / remaining**5)
        return [x, v_s + direction * speed, a_s + direction * slope], share / T

    def run(self, inputs: Sequence[Row], h: float) -> list[Row]:
        """The outputs of a run, one row more than steps; inputs by FMI name are held from row to row."""
        filters, first, load = self.filters, inputs[0], self.load
        transitions = {name: linear.transition(h) for name, linear in filters.items()}
        states = {name: np.zeros(len(linear.A)) for name, linear in filters.items()}
        rest = first["F_hat"] / load.k + math.copysign(load.b / 2.0, first["F_hat"])
        gap = first["x_1"] - rest - first["x_d"]
        r, z, deflection, rows = 0.0, 0.0, 0.0, list[Row]()
        # the row of the start, and one of each step with the inputs held in it
        for k, (before, u) in enumerate(pairwise([first, first, *inputs[:-1]])):
            x, before_x = (row["x_d"] - first["x_d"] for row in (u, before))
            if k > 1:
                line = [before_x, (x - before_x) / h]
                states = {name: transitions[name] @ [*state, *line] for name, state in states.items()}
            shaped = filters["x_s"].outputs(states["x_s"], (x, u["v_d"], u["a_d"]))
            shaped[0] += first["x_d"]
            if k > 0:
                r = min(r + h * self.approached(gap, r, shaped)[1], 1.0)
            (x_p, v_p, a_p), _ = self.approached(gap, r, shaped)
            rate = -float(np.dot(self.gains, (u["load.x"] - x_p, u["load.v"] - v_p, u["load.a"] - a_p)))
            z = min(max(z + h * rate, -self.limit), self.limit) if k > 0 else z
            wanted_deflection, change = (u["F_hat"] + load.m * a_p) / load.k, 0.0
            if k > 1:
                change = min(max((wanted_deflection - deflection) / h, -self.v_max), self.v_max)
            deflection = deflection + h * change if k > 1 else wanted_deflection
            rows.append(
                {
                    "x_c": x_p + deflection + math.copysign(load.b / 2.0, u["F_hat"]) + z,
                    "v_c": v_p + change + (rate if abs(z) < self.limit else 0.0),
                    "a_c": a_p,
                    **dict(zip(("x_s", "v_s", "a_s"), shaped, strict=True)),
                    "deflection": deflection,
                    "correction": z,
                    **{
                        name: filters[name].outputs(x, (0.0,) * 3)[0]
                        for name, x in states.items()
                        if name != "x_s"
                    },
                }
            )
        return rows


@dataclass(frozen=True)
class Observer:
    """The observer of a load with its gains on the innovation."""

    load: Load
    gains: tuple[float, float, float]

    @property
    def matrices(self) -> tuple[Vector, Vector]:
        """A of position, speed and acceleration by unknown forces; B of y, the screw and its speed."""
        load, gains = self.load, np.array([self.gains]).T
        model = np.array([[0.0, 1.0, 0.0], [-load.k / load.m, -load.c / load.m, 1.0], [0.0, 0.0, 0.0]])
        forces = np.array([[0.0, 0.0], [load.k / load.m, load.c / load.m], [0.0, 0.0]])
        return model - gains @ np.array([[1.0, 0.0, 0.0]]), np.hstack([gains, forces])

    def run(self, inputs: Sequence[Row], h: float) -> list[Row]:
        """The outputs of a run, one row more than steps; inputs by FMI name are held from row to row.

        Positions of the load count from the first one, those of the screw from that without a force of the
        first deflection: then forces are those that change.
        """
        A, B = self.matrices
        first, load = inputs[0], self.load
        deflection = first["x_1"] - first["y"]
        force = load.k * math.copysign(max(abs(deflection) - load.b / 2.0, 0.0), deflection)
        transition = Linear(A, B, np.zeros(3), np.zeros(3)).transition(h)

        def signals(u: Row) -> Vector:
            return np.array([u["y"] - first["y"], u["x_1"] - first["x_1"], u["v_1"]])

        x, rows = np.zeros(3), list[Row]()
        for k, (before, u) in enumerate(pairwise([first, first, *inputs[:-1]])):
            now, then = signals(u), signals(before)
            if k > 0:
                x = transition @ [*x, *then, *((now - then) / h)]
            y, x_1, v_1 = now
            acceleration = (load.k * (x_1 - x[0]) + load.c * (v_1 - x[1])) / load.m + x[2]
            estimates = {"travel": x[0], "v_hat": x[1], "f_hat": x[2], "x_hat": first["y"] + x[0]}
            further = {"a_hat": acceleration, "F_0": force, "y_bar": y - x[0]}
            rows.append({name: float(value) for name, value in (estimates | further).items()})
        return rows

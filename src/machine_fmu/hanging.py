"""What swings freely, at rest: passive coordinates that the strokes determine, by the weight alone."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import casadi

_MAX_CHANGE = 0.5
"""Largest change in rad or m of a coordinate in one step towards rest."""

ANYWHERE = 1e-9
"""Share of the stiffness below which a coordinate rests anywhere, such as a turn about the vertical."""

_MIN_STIFFNESS = 1e-6
"""Share of the largest stiffness below which a force does not deflect a coordinate by a definite amount."""


class Following(NamedTuple):
    """How unknowns follow the strokes: their derivatives by strokes, speeds and accelerations."""

    slopes: "casadi.SX"
    speeds: "casadi.SX"
    growths: "casadi.SX"


def follow(errors: "casadi.SX", q: "casadi.SX", x: "casadi.SX", v: "casadi.SX", a: "casadi.SX") -> Following:
    """Return how unknowns x move while errors, which depend on strokes q and on them, remain zero.

    Args:
        errors: As many as there are unknowns.
        q: Strokes, m.
        x: Unknowns, m or rad.
        v: Speeds of the strokes, m/s.
        a: Their accelerations, m/s2.
    """
    import casadi  # slow to import, and most machines have nothing that swings

    variables, n = casadi.vertcat(q, x), q.numel()
    jacobian = casadi.jacobian(errors, variables)
    slopes = -casadi.solve(jacobian[:, n:], jacobian[:, :n])
    speeds = slopes @ v
    direction = casadi.SX.sym("along", variables.numel())
    curvature = casadi.jtimes(casadi.jtimes(errors, variables, direction), variables, direction)
    curvature = casadi.substitute(curvature, direction, casadi.vertcat(v, speeds))
    return Following(slopes, speeds, slopes @ a - casadi.solve(jacobian[:, n:], curvature))


def stiffness(torques: "casadi.SX", errors: "casadi.SX", x: "casadi.SX", passive: "casadi.SX") -> "casadi.SX":
    """Return the derivatives of torques of passive coordinates by these, while x closes the machine."""
    import casadi

    direct = casadi.jacobian(torques, passive)
    if not x.numel():
        return direct
    closing = casadi.solve(casadi.jacobian(errors, x), casadi.jacobian(errors, passive))
    return direct - casadi.jacobian(torques, x) @ closing


def descend(torques: np.ndarray, stiffnesses: np.ndarray) -> np.ndarray:
    """Return changes of passive coordinates towards less potential energy, one row per pose; NaN as given.

    Near rest they are those of Newton's method. This alone would also come to rest upside down.

    Args:
        torques: Torques or forces of the coordinates at rest, N m or N, one row per pose.
        stiffnesses: Their symmetric derivatives, one matrix per pose.
    """
    changes = np.full_like(torques, np.nan)
    rows = np.isfinite(torques).all(axis=1) & np.isfinite(stiffnesses).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(stiffnesses[rows])
    sizes = np.abs(values)
    sizes = np.maximum(sizes, ANYWHERE * (1.0 + sizes.max(axis=1, keepdims=True)))
    parts = np.einsum("rij,ri->rj", vectors, torques[rows]) / sizes
    changes[rows] = np.einsum("rij,rj->ri", vectors, np.clip(parts, -_MAX_CHANGE, _MAX_CHANGE))
    return -changes


def deflections(torques: np.ndarray, stiffnesses: np.ndarray) -> np.ndarray:
    """Return by how much constant torques deflect passive coordinates, in rad or m; see `descend`."""
    return np.einsum("rij,rj->ri", np.linalg.pinv(stiffnesses, rcond=_MIN_STIFFNESS, hermitian=True), torques)

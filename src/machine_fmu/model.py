"""A machine with its numbers, and its mechanics as functions of many poses at once.

Blocks do not use this: it needs CasADi and NumPy, and finds poses by as many iterations as they need.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from .assembly import assemble, locate_outlines, locate_points
from .closure import ITERATIONS, closure_errors, find_closure
from .description import GROUND, Machine, MachineError
from .dynamics import Dynamics
from .exact import plain
from .mechanism import End, Mechanism
from .naming import name_numbers
from .pose import Pose

_MANY = 50
"""Largest number of Newton's iterations for a pose."""

_NEAR = 1e-12
"""Change in m or rad by an iteration at which a pose is found."""

_PART = 0.02
"""Largest change of a stroke in m between two poses that Newton's method joins."""

_FEW, _FAR, _CLOSE = 100, 0.1, 1e-6
"""Rows and mean distance in m above which poses are sought together, and their last change in m or rad."""


_ANYWHERE = 1e-9
"""Share of stiffness below which a passive coordinate rests anywhere."""


class MachineModel:
    """A machine with values of its numbers.

    Rows of arrays are poses; columns of strokes, speeds and forces are the actuators in their order. Passive
    coordinates, such as a hook, are held as in the assembly pose, except where `passive` gives them, in m or
    rad; see `hanging`.

    Args:
        machine: The description.
        values: Numbers by name, as the variables of its blocks have them, which replace those of the
            description.

    Raises:
        MachineError: A name does not exist, or lengths do not determine the pose.
    """

    def __init__(self, machine: Machine, values: Mapping[str, float] | None = None) -> None:
        named = name_numbers(machine)
        parameters = dict(named.parameters)
        for name, value in (values or {}).items():
            if name not in parameters:
                raise MachineError(f"the machine has no number '{name}'; existing: {', '.join(parameters)}")
            parameters[name] = replace(parameters[name], value=float(value))
        self.machine = replace(named, parameters=parameters)
        # blocks keep the sides of their description, whatever their parameters
        self.closure = replace(find_closure(self.machine), sides=find_closure(named).sides)
        self.mechanism = assemble(self.machine)

    @property
    def names(self) -> tuple[str, ...]:
        """The actuators in their order."""
        return tuple(self.machine.actuators)

    @property
    def passive_names(self) -> tuple[str, ...]:
        """Names of the passive coordinates."""
        return tuple(self.mechanism.frames[self.mechanism.frame_of(i)].name for i in self.mechanism.passive)

    @property
    def dimensions(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.machine.dimensions

    @property
    def payload(self) -> float:
        """Mass of the payload in kg; 0 without one."""
        return 0.0 if self.machine.payload is None else self.machine.payload.m

    @cached_property
    def q_LB(self) -> tuple[float, ...]:
        """Lower ends of the strokes, m."""
        return tuple(self.number(actuator.stroke[0]) for actuator in self.machine.actuators.values())

    @cached_property
    def q_UB(self) -> tuple[float, ...]:
        """Upper ends of the strokes, m."""
        return tuple(self.number(actuator.stroke[1]) for actuator in self.machine.actuators.values())

    @cached_property
    def start(self) -> tuple[float, ...]:
        """Strokes at the start, m."""
        starts = []
        for bar in self.mechanism.actuators:
            given = self.machine.actuators[bar.name].start
            as_assembled = self.closure.lengths[bar.name] - float(plain(bar.length))
            starts.append(as_assembled if given is None else given)
        return tuple(starts)

    def dynamics(
        self, q: Sequence[Any], payload: Any = None, guess: Mapping[int, Any] | None = None
    ) -> Dynamics:
        """Return the dynamics at strokes, on floats or symbols of CasADi.

        Args:
            q: Strokes, m.
            payload: Mass of the payload in kg; that of the description without.
            guess: Coordinates that Newton's method finds, by number, near the solution; needed where
                `closure.iterated` has any. See `poses`.
        """
        mechanism = self.mechanism if payload is None else self._loaded(payload)
        held = [self.closure.assembly[i] for i in mechanism.passive]
        return Dynamics(mechanism, self.closure, q, held, guess)

    def at(self, q: casadi.SX, x: casadi.SX, payload: float | None = None) -> Dynamics:
        """Return the dynamics at symbols of strokes, and of the coordinates that Newton's method finds.

        They are those of the pose only where `errors` are zero.
        """
        mechanism = self.mechanism if payload is None else self._loaded(payload)
        guess = dict(zip(self.closure.iterated, casadi.vertsplit(x), strict=True)) or None
        held = [self.closure.assembly[i] for i in mechanism.passive]
        return Dynamics(mechanism, self.closure, casadi.vertsplit(q), held, guess, 0)

    def inverse(self, dynamics: Dynamics, v: casadi.SX, a: casadi.SX) -> casadi.SX:
        """Return the forces of the actuators in N for speeds and accelerations of the strokes."""
        none = [0.0] * len(dynamics.mechanism.passive)
        rows = dynamics.inverse([*casadi.vertsplit(v), *none], [*casadi.vertsplit(a), *none])
        return casadi.vertcat(*rows[: len(self.names)])

    def errors(self, dynamics: Dynamics) -> casadi.SX:
        """Return how far a pose is from its lengths in m; empty if no coordinate needs Newton's method."""
        return casadi.vertcat(*closure_errors(dynamics.pose, self.closure, dynamics.lengths))

    def place(self, dynamics: Dynamics, names: Sequence[str]) -> casadi.SX:
        """Return the coordinates in m of points of `ends`, one after the other."""
        return casadi.vertcat(*(self._place(dynamics.pose, self.ends[name]) for name in names))

    def poses(self, strokes: np.ndarray) -> np.ndarray:
        """Return the coordinates that Newton's method finds; one row per pose, NaN where there is none.

        Each pose is sought from that of the row before, and then in parts from the start. Rows that are far
        apart, as those of a grid, are sought together, all from the start.

        Args:
            strokes: Strokes in m, one row per pose.
        """
        iterated = self.closure.iterated
        found = np.full((len(strokes), len(iterated)), np.nan)
        if not iterated:
            return found
        first = np.array([self.closure.assembly[i] for i in iterated])
        before, last = first, np.array(self.start)
        strokes = np.asarray(strokes, dtype=float)
        if len(strokes) > _FEW and np.abs(np.diff(strokes, axis=0)).max(axis=1).mean() > _FAR:
            return self._poses_apart(strokes, first)
        for row, q in enumerate(strokes):
            if not np.isfinite(q).all():
                continue
            x = self._continued(last, q, before)
            if not np.isfinite(x).all():
                x = self._continued(np.array(self.start), q, first)
            found[row] = x
            if np.isfinite(x).all():
                before, last = x, q
        return found

    def forces(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        payload: float | np.ndarray | None = None,
        passive: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the forces of the actuators in N for their motion, positive against extension of a load.

        Args:
            q: Strokes in m, one row per pose.
            v: Speeds, m/s.
            a: Accelerations, m/s2.
            payload: Mass in kg, also one for each row; that of the description without.
            passive: Passive coordinates.
        """
        return self._evaluate("forces", self.inverse, q, payload, v, a, passive=passive)

    def energy(self, q: np.ndarray, v: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the energy in J for each row; arguments as in `forces`."""

        def equation(dynamics: Dynamics, v: Any) -> Any:
            return dynamics.energy([*casadi.vertsplit(v), *[0.0] * len(dynamics.mechanism.passive)])

        return self._evaluate("energy", equation, q, payload, v)[:, 0]

    def holding_forces(self, q: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the forces in N that hold the machine at rest; passive coordinates hang freely."""
        at_rest = np.zeros((len(q), len(self.names)))
        return self.forces(q, at_rest, at_rest, payload, self.hanging(q, payload))

    def hanging(self, q: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the passive coordinates at rest for each row of strokes; NaN where they do not come to rest.

        They are followed from where they rest at the start. Those that rest anywhere are as assembled.
        """
        q, start = np.asarray(q, dtype=float), np.array([self.start])
        x = np.array([[self.closure.assembly[i] for i in self.mechanism.passive]])
        if not x.size:
            return np.zeros((len(q), 0))
        moves = np.zeros(len(q), dtype=bool)
        for _ in range(_MANY):
            x = x - self._unrest(start, self.payload, x)
        x = np.tile(x, (len(q), 1))
        parts = max(1, int(np.ceil(np.nanmax(np.abs(q - start), initial=0.0) / _FAR)))
        for share in [*np.linspace(0.0, 1.0, parts + 1)[1:], *[1.0] * ITERATIONS]:
            x = x - (change := self._unrest(start + share * (q - start), payload, x))
            moves = ~(np.abs(change).max(axis=1) <= _CLOSE)
        x[moves] = np.nan
        return x

    def _unrest(self, q: np.ndarray, payload: float | np.ndarray | None, passive: np.ndarray) -> np.ndarray:
        """Return Newton's change of passive coordinates that are to rest."""

        def equation(dynamics: Dynamics) -> Any:
            rest = [0.0] * dynamics.variables
            torque = casadi.vertcat(*dynamics.inverse(rest, rest)[len(self.names) :])
            slope = casadi.jacobian(torque, self._passive)
            square = slope.T @ slope
            # coordinates that rest anywhere, such as a turn about the vertical, stay where they are
            square += _ANYWHERE * (1.0 + casadi.trace(square)) * casadi.SX.eye(slope.size1())
            return casadi.solve(square, slope.T @ torque)

        return self._evaluate("unrest", equation, q, payload, passive=passive)

    def tip(self, q: np.ndarray, passive: np.ndarray | None = None) -> np.ndarray:
        """Return the position of the tip in m for each row of strokes: x and y, in space also z.

        It is the point of the payload; without a payload, the last point of the last body.
        """
        end = self.mechanism.payload or list(self.ends.values())[-1]
        return self._evaluate(
            "tip", lambda dynamics: self._place(dynamics.pose, end), q, None, passive=passive
        )

    def points(
        self, q: np.ndarray, names: Iterable[str] | None = None, passive: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """Return the positions in m of points for each row of strokes.

        Keys are BODY for the origin of a body, and BODY.POINT; the ground is the body 'ground'.

        Args:
            q: Strokes in m, one row per pose.
            names: The points; all by default.
            passive: Passive coordinates.
        """
        ends = list(self.ends if names is None else names)
        found = self._evaluate(
            " ".join(["points", *ends]), lambda dynamics: self.place(dynamics, ends), q, None, passive=passive
        )
        n = self.dimensions
        return {name: found[:, n * i : n * (i + 1)] for i, name in enumerate(ends)}

    def frames(
        self, q: np.ndarray, passive: np.ndarray | None = None
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the frames of all bodies and of the ground for each row of strokes.

        Args:
            q: Strokes in m, one row per pose.
            passive: Passive coordinates.

        Returns:
            By body, the positions of its origin in m, and its rotations: the columns are its axes.
        """
        bodies = (GROUND, *self.machine.bodies)
        n, size = self.dimensions, self.dimensions + self.dimensions**2

        def equation(dynamics: Dynamics) -> Any:
            rows = []
            for body in bodies:
                rotation = dynamics.pose.rotation(self.ends[body].frame)
                rows.append(self._place(dynamics.pose, self.ends[body]))
                rows += [plain(x) for row in rotation[:n] for x in row[:n]]
            return casadi.vertcat(*rows)

        values = self._evaluate("frames", equation, q, None, passive=passive).reshape(-1, len(bodies), size)
        return {body: (values[:, i, :n], values[:, i, n:].reshape(-1, n, n)) for i, body in enumerate(bodies)}

    @cached_property
    def outline(self) -> np.ndarray:
        """Corners of the outline of the base in m, one row each."""
        corners = locate_outlines(self.machine).get(GROUND, ())
        rows = [[float(plain(x)) for x in corner.at[: self.dimensions]] for corner in corners]
        return np.array(rows).reshape(len(rows), self.dimensions)

    @cached_property
    def ends(self) -> dict[str, End]:
        """All points of bodies and of the ground, by BODY or BODY.POINT."""
        return locate_points(self.machine)

    def number(self, number: float | str) -> float:
        """Return the value of a number of the description."""
        if not isinstance(number, str):
            return float(number)
        value = self.machine.parameters[number.removeprefix("-")].value
        return -value if number.startswith("-") else value

    def _loaded(self, payload: Any) -> Mechanism:
        return assemble(self.machine, None, payload)

    def _place(self, pose: Pose, end: End) -> Any:
        return casadi.vertcat(*(plain(x) for x in pose.point(end)[: self.dimensions]))

    def _continued(self, last: np.ndarray, q: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return the coordinates at strokes q, from those at other strokes; NaN if they are not reached."""
        parts = max(1, int(np.ceil(np.abs(q - last).max() / _PART)))
        x = guess
        for part in range(1, parts + 1):
            there = last + part / parts * (q - last)
            for _ in range(_MANY):
                before = x
                x = np.array(self._improved(there, x)).ravel()
                if not np.isfinite(x).all() or np.abs(x - before).max() <= _NEAR:
                    break
            else:
                return np.full(len(x), np.nan)
        return x

    def _poses_apart(self, strokes: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return the coordinates of all rows, each in parts from the start; NaN where there is no pose."""
        start = np.array(self.start)
        improved = self._improved.map(len(strokes))
        parts = max(1, int(np.ceil(np.nanmax(np.abs(strokes - start)) / _PART)))
        x = np.tile(first[:, None], len(strokes))
        for part in range(1, parts + 1):
            there = (start + part / parts * (strokes - start)).T
            for _ in range(ITERATIONS):
                x = np.array(improved(there, x))
        before, x = x, np.array(improved(strokes.T, x))
        x[:, ~(np.abs(x - before).max(axis=0) <= _CLOSE)] = np.nan
        return np.array(improved(strokes.T, x)).T

    @cached_property
    def _improved(self) -> casadi.Function:
        """One iteration of Newton's method: from strokes and a guess to the coordinates."""
        q = casadi.SX.sym("q", len(self.names))
        x = casadi.SX.sym("x", len(self.closure.iterated))
        guess = dict(zip(self.closure.iterated, casadi.vertsplit(x), strict=True))
        held = [self.closure.assembly[i] for i in self.mechanism.passive]
        pose = Dynamics(self.mechanism, self.closure, casadi.vertsplit(q), held, guess, 1).pose
        return casadi.Function("improved", [q, x], [casadi.vertcat(*(pose.numbers[i] for i in guess))])

    def _evaluate(
        self,
        name: str,
        equation: Callable[..., Any],
        q: np.ndarray,
        payload: float | np.ndarray | None,
        *motion: np.ndarray,
        passive: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return a function of poses, speeds and so on, one row per pose."""
        q = np.asarray(q, dtype=float)
        if name not in self._functions:
            symbols = [casadi.SX.sym(f"s{i}", len(self.names)) for i in range(1 + len(motion))]
            x, m = casadi.SX.sym("x", len(self.closure.iterated)), casadi.SX.sym("m")
            guess = dict(zip(self.closure.iterated, casadi.vertsplit(x), strict=True)) or None
            held, strokes = casadi.vertsplit(self._passive), casadi.vertsplit(symbols[0])
            dynamics = Dynamics(self._loaded(m), self.closure, strokes, held, guess)
            result = equation(dynamics, *symbols[1:])
            self._functions[name] = casadi.Function("f", [*symbols, x, self._passive, m], [result])
        loads = np.broadcast_to(self.payload if payload is None else payload, len(q))
        columns = [np.asarray(s, dtype=float).T for s in (q, *motion)]
        poses = self.poses(q).T
        if passive is None:
            passive = np.tile([self.closure.assembly[i] for i in self.mechanism.passive], (len(q), 1))
        function = self._functions[name].map(len(q))
        return np.array(function(*columns, poses, np.asarray(passive).T, loads[None, :])).T

    @cached_property
    def _passive(self) -> casadi.SX:
        return casadi.SX.sym("p", len(self.mechanism.passive))

    @cached_property
    def _functions(self) -> dict[str, casadi.Function]:
        return {}

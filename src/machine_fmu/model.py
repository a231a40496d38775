"""A machine with its numbers, and its mechanics as functions of many poses at once.

Blocks do not use this: it needs NumPy, and finds poses by as many iterations as they need. Only machines with
Newton's method or passive coordinates need CasADi.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fmublock.row_array import evaluate_rows

from .assembly import locate_outlines
from .closure import ITERATIONS
from .description import GROUND
from .dynamics import Dynamics
from .exact import plain
from .hanging import deflections, descend
from .mechanics import Mechanics
from .mechanism import Frame

if TYPE_CHECKING:
    import casadi

_MAX_ITERATIONS = 50
"""Largest number of Newton's iterations for a pose."""

_TOLERANCE = 1e-12
"""Change in m or rad by an iteration at which a pose is found."""

_MAX_STROKE_CHANGE = 0.02
"""Largest change of a stroke in m between two poses that Newton's method joins."""

_MIN_ROWS, _LARGE_DISTANCE, _LOOSE_TOLERANCE = 100, 0.1, 1e-6
"""Rows and mean distance in m above which poses are sought together, and their last change in m or rad."""


class MachineModel(Mechanics):
    """A machine with values of its numbers, for many poses at once.

    Rows of arrays are poses; columns of strokes, speeds and forces are the actuators in their order. Passive
    coordinates, such as a hook, hang at rest in each pose, except where `passive` gives them, in m or rad.
    So they follow a motion without swinging; see `swing`.

    Args:
        machine: The description.
        values: Numbers by name, as the variables of its blocks have them, which replace those of the
            description.

    Raises:
        MachineError: A name does not exist, or lengths do not determine the pose.
    """

    @property
    def passive_frames(self) -> tuple[Frame, ...]:
        """The frames that passive coordinates move."""
        return tuple(self.mechanism.frames[self.mechanism.frame_of(i)] for i in self.mechanism.passive)

    @property
    def payload(self) -> float:
        """Mass of the payload in kg; 0 without one."""
        return 0.0 if self.machine.payload is None else self.machine.payload.m

    @cached_property
    def q_LB(self) -> tuple[float, ...]:
        """Lower ends of the strokes, m."""
        return tuple(self.machine.value(actuator.stroke[0]) for actuator in self.machine.actuators.values())

    @cached_property
    def q_UB(self) -> tuple[float, ...]:
        """Upper ends of the strokes, m."""
        return tuple(self.machine.value(actuator.stroke[1]) for actuator in self.machine.actuators.values())

    @cached_property
    def start(self) -> tuple[float, ...]:
        """Strokes at the start, m."""
        starts = []
        for bar in self.mechanism.actuators:
            stroke = self.machine.actuators[bar.name].start
            assembly_stroke = self.closure.lengths[bar.name] - float(plain(bar.length))
            starts.append(assembly_stroke if stroke is None else stroke)
        return tuple(starts)

    def poses(self, strokes: np.ndarray) -> np.ndarray:
        """Return the coordinates that Newton's method finds; one row per pose, NaN where there is none.

        Each pose is sought from that of the row before, and then in parts from the start. Rows that are far
        apart, as those of a grid, are sought together, all from the start.

        Args:
            strokes: Strokes in m, one row per pose.
        """
        iterated = self.closure.iterated
        coordinates = np.full((len(strokes), len(iterated)), np.nan)
        if not iterated:
            return coordinates
        first = np.array([self.closure.assembly[i] for i in iterated])
        previous, last_strokes = first, np.array(self.start)
        strokes = np.asarray(strokes, dtype=float)
        if len(strokes) > _MIN_ROWS and np.abs(np.diff(strokes, axis=0)).max(axis=1).mean() > _LARGE_DISTANCE:
            return self._find_poses_together(strokes, first)
        for row, q in enumerate(strokes):
            if not np.isfinite(q).all():
                continue
            x = self._continue_pose(last_strokes, q, previous)
            if not np.isfinite(x).all():
                x = self._continue_pose(np.array(self.start), q, first)
            coordinates[row] = x
            if np.isfinite(x).all():
                previous, last_strokes = x, q
        return coordinates

    def find_unknowns(
        self, q: np.ndarray, payload: float | np.ndarray | None = None, passive: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the values of `unknowns` for each row of strokes; NaN where there are none."""
        passive = self.hanging(q, payload) if passive is None else np.asarray(passive, dtype=float)
        x = self.poses(q)
        if passive.size and x.size:
            newton_step = self._newton_step.map(len(x))
            for _ in range(ITERATIONS):
                x = np.array(newton_step(q.T, x.T, passive.T)).T
        return np.hstack([x, passive])

    def forces(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, payload: float | np.ndarray | None = None
    ) -> np.ndarray:
        """Return the forces of the actuators in N for their motion, positive against extension of a load.

        Args:
            q: Strokes in m, one row per pose.
            v: Speeds, m/s.
            a: Accelerations, m/s2.
            payload: Mass in kg, also one for each row; that of the description without.
        """
        return self._evaluate("forces", self.inverse, q, payload, v, a)

    def energy(self, q: np.ndarray, v: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the energy in J for each row; arguments as in `forces`."""
        return self._evaluate("energy", lambda *args: [self.energy_of(*args)], q, payload, v)[:, 0]

    def holding_forces(self, q: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the forces in N that hold the machine at rest."""
        at_rest = np.zeros((len(q), len(self.names)))
        return self.forces(q, at_rest, at_rest, payload)

    def swing(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, payload: float | np.ndarray | None = None
    ) -> np.ndarray:
        """Return how far a motion takes passive coordinates from where they hang, in rad or m, for each row.

        It is the deflection by the accelerations there, without the swinging that follows. Arguments are as
        in `forces`.
        """
        if not self.mechanism.passive:
            return np.zeros((len(q), 0))
        torques = self._evaluate(
            "swing", lambda *args: self.rows(*args)[0][len(self.names) :], q, payload, v, a
        )
        return deflections(torques, self._evaluate_balance(q, self.hanging(q, payload), payload)[1])

    def hanging(self, q: np.ndarray, payload: float | np.ndarray | None = None) -> np.ndarray:
        """Return the passive coordinates at rest for each row of strokes; NaN where they do not come to rest.

        They are followed from where they rest at the start. Those that rest anywhere are as assembled.
        """
        q, start = np.asarray(q, dtype=float), np.array([self.start])
        passive = self._assembly_passive[None]
        if not passive.size:
            return np.zeros((len(q), 0))
        passive = np.tile(self._descend_to_rest(start, passive, self.payload, _MAX_ITERATIONS), (len(q), 1))
        parts = max(1, int(np.ceil(np.nanmax(np.abs(q - start), initial=0.0) / _LARGE_DISTANCE)))
        for share in np.linspace(0.0, 1.0, parts, endpoint=False)[1:]:
            passive = self._descend_to_rest(start + share * (q - start), passive, payload, 1)
        return self._descend_to_rest(q, passive, payload, _MAX_ITERATIONS)

    def _descend_to_rest(
        self, q: np.ndarray, passive: np.ndarray, payload: float | np.ndarray | None, max_steps: int
    ) -> np.ndarray:
        """Return passive coordinates after steps towards rest; NaN if `_MAX_ITERATIONS` do not reach it."""
        change = np.zeros_like(passive)
        for _ in range(max_steps):
            change = descend(*self._evaluate_balance(q, passive, payload))
            passive = passive + change
            if not (np.abs(change) > _LOOSE_TOLERANCE).any():
                return passive
        is_far = (np.abs(change) > _LOOSE_TOLERANCE).any(axis=1, keepdims=True)
        return np.where(is_far & (max_steps == _MAX_ITERATIONS), np.nan, passive)

    def _evaluate_balance(
        self, q: np.ndarray, passive: np.ndarray, payload: float | np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return torques of passive coordinates at rest, and their derivatives, one matrix per pose."""
        count = passive.shape[1]
        values = self._evaluate("balance", self.balance, q, payload, passive=passive)
        return values[:, :count], values[:, count:].reshape(-1, count, count)

    def tip(
        self, q: np.ndarray, passive: np.ndarray | None = None, payload: float | np.ndarray | None = None
    ) -> np.ndarray:
        """Return the position of the tip in m for each row of strokes: x and y, in space also z.

        It is the point of the payload; without a payload, the last point of the last body. The payload's mass
        in kg decides where passive coordinates hang.
        """
        end = self.mechanism.payload or list(self.ends.values())[-1]
        return self._evaluate(
            "tip", lambda q, x, m: self.locate(self.at(q, x), [end]), q, payload, passive=passive
        )

    def points(
        self,
        q: np.ndarray,
        names: Iterable[str] | None = None,
        passive: np.ndarray | None = None,
        payload: float | np.ndarray | None = None,
    ) -> dict[str, np.ndarray]:
        """Return the positions in m of points for each row of strokes.

        Keys are BODY for the origin of a body, and BODY.POINT; the ground is the body 'ground'.

        Args:
            q: Strokes in m, one row per pose.
            names: The points; all by default.
            passive: Passive coordinates.
            payload: Mass in kg, with which passive coordinates hang.
        """
        names = list(self.ends if names is None else names)
        ends = [self.ends[name] for name in names]
        positions = self._evaluate(
            " ".join(["points", *names]),
            lambda q, x, m: self.locate(self.at(q, x), ends),
            q,
            payload,
            passive=passive,
        )
        n = self.dimensions
        return {name: positions[:, n * i : n * (i + 1)] for i, name in enumerate(names)}

    def frames(
        self, q: np.ndarray, passive: np.ndarray | None = None, payload: float | np.ndarray | None = None
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the frames of all bodies and of the ground for each row of strokes.

        Args:
            q: Strokes in m, one row per pose.
            passive: Passive coordinates.
            payload: Mass in kg, with which passive coordinates hang.

        Returns:
            By body, the positions of its origin in m, and its rotations: the columns are its axes.
        """
        ends = {body: self.ends[body] for body in (GROUND, *self.machine.bodies)}
        n, size = self.dimensions, self.dimensions + self.dimensions**2

        def equation(q: Sequence[Any], x: Sequence[Any], payload: Any) -> list[Any]:
            dynamics, rows = self.at(q, x), []
            for end in ends.values():
                rows += self.locate(dynamics, [end])
                rows += [plain(x) for row in dynamics.pose.rotation(end.frame)[:n] for x in row[:n]]
            return rows

        values = self._evaluate("frames", equation, q, payload, passive=passive).reshape(-1, len(ends), size)
        return {body: (values[:, i, :n], values[:, i, n:].reshape(-1, n, n)) for i, body in enumerate(ends)}

    @cached_property
    def outline(self) -> np.ndarray:
        """Corners of the outline of the base in m, one row each."""
        corners = locate_outlines(self.machine).get(GROUND, ())
        rows = [[float(plain(x)) for x in corner.at[: self.dimensions]] for corner in corners]
        return np.array(rows).reshape(len(rows), self.dimensions)

    def _continue_pose(self, last: np.ndarray, q: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return the coordinates at strokes q, from those at other strokes; NaN if they are not reached."""
        parts = max(1, int(np.ceil(np.abs(q - last).max() / _MAX_STROKE_CHANGE)))
        x = guess
        for part in range(1, parts + 1):
            strokes = last + part / parts * (q - last)
            for _ in range(_MAX_ITERATIONS):
                previous = x
                x = np.array(self._newton_step(strokes, x, self._assembly_passive)).ravel()
                if not np.isfinite(x).all() or np.abs(x - previous).max() <= _TOLERANCE:
                    break
            else:
                return np.full(len(x), np.nan)
        return x

    def _find_poses_together(self, strokes: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return the coordinates of all rows, each in parts from the start; NaN where there is no pose."""
        start = np.array(self.start)
        newton_step, passive = (
            self._newton_step.map(len(strokes)),
            np.tile(self._assembly_passive[:, None], len(strokes)),
        )
        parts = max(1, int(np.ceil(np.nanmax(np.abs(strokes - start)) / _MAX_STROKE_CHANGE)))
        x = np.tile(first[:, None], len(strokes))
        for part in range(1, parts + 1):
            part_strokes = (start + part / parts * (strokes - start)).T
            for _ in range(ITERATIONS):
                x = np.array(newton_step(part_strokes, x, passive))
        previous, x = x, np.array(newton_step(strokes.T, x, passive))
        x[:, ~(np.abs(x - previous).max(axis=0) <= _LOOSE_TOLERANCE)] = np.nan
        return np.array(newton_step(strokes.T, x, passive)).T

    @cached_property
    def _newton_step(self) -> "casadi.Function":
        """One iteration of Newton's method: from strokes, a guess and passive coordinates to the others.

        A pose begins from the one before, so that calls are for single poses. For these, a function of CasADi
        is faster than the equations on arrays.
        """
        import casadi  # slow to import

        q, passive = casadi.SX.sym("q", len(self.names)), casadi.SX.sym("p", len(self.mechanism.passive))
        x = casadi.SX.sym("x", len(self.closure.iterated))
        guess = dict(zip(self.closure.iterated, casadi.vertsplit(x), strict=True))
        passive_numbers = casadi.vertsplit(passive)
        pose = Dynamics(self.mechanism, self.closure, casadi.vertsplit(q), passive_numbers, guess, 1).pose
        return casadi.Function(
            "improved", [q, x, passive], [casadi.vertcat(*(pose.numbers[i] for i in guess))]
        )

    @property
    def _assembly_passive(self) -> np.ndarray:
        """Passive coordinates of the assembly pose."""
        return np.array([self.closure.assembly[i] for i in self.mechanism.passive])

    def _evaluate(
        self,
        name: str,
        equation: Callable[..., Sequence[Any]],
        q: np.ndarray,
        payload: float | np.ndarray | None,
        *motion: np.ndarray,
        passive: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return numbers of poses, unknowns, speeds and so on, and the payload; one row per pose."""
        q = np.asarray(q, dtype=float)
        unknowns = self.find_unknowns(q, payload, passive)
        loads = np.broadcast_to(self.payload if payload is None else payload, len(q))[:, None]
        columns = [np.asarray(values, dtype=float) for values in (q, unknowns, *motion, loads)]
        if self.mechanism.passive:
            function = self._function(name, equation, [values.shape[1] for values in columns])
            return np.array(function.map(len(q))(*(values.T for values in columns))).T
        return evaluate_rows(lambda *numbers: equation(*numbers[:-1], *numbers[-1]), *columns)

    def _function(
        self, name: str, equation: Callable[..., Sequence[Any]], counts: Sequence[int]
    ) -> "casadi.Function":
        """Return a function of an equation, which may contain derivatives, for columns of numbers."""
        import casadi

        if name not in self._functions:
            symbols = [casadi.SX.sym(f"s{i}", count) for i, count in enumerate(counts)]
            *numbers, (mass,) = map(casadi.vertsplit, symbols)
            self._functions[name] = casadi.Function("f", symbols, [casadi.vertcat(*equation(*numbers, mass))])
        return self._functions[name]

    @cached_property
    def _functions(self) -> "dict[str, casadi.Function]":
        return {}

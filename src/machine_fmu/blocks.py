"""Blocks of a machine: as a load, motion in and forces out, and merged with the mechanics of its actuators.

Elements of vectors are the actuators in the order of the description. What Newton's method finds is also a
state, `pose`: it moves with the strokes, so that each evaluation begins close to the solution.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from fmublock import Block, DefaultExperiment, Parameter

from .actuators import screw_forces
from .assembly import assemble
from .closure import ITERATIONS, Closure
from .description import Machine
from .dynamics import Dynamics
from .exact import ZERO, is_zero, plain
from .guards import Guards
from .linear import solve_symmetric
from .mechanism import Mechanism
from .vectors import NONE

_CORRECTION = 50.0
"""Rate in 1/s at which the state `pose` returns to the solution."""

_BESIDE = 1e-16
"""Largest square of the distance in m2 of a bar from the slide that it is parallel to."""

_CLOSE = 1e-6
"""Largest change in m or rad by the last iteration of a pose that is found."""

_MASSLESS = 1e-12
"""Largest mass in kg, or inertia in kg m2, that counts as none."""

AXES_NAMES = "xyz"


class MachineBlock(Block):
    """Base of the blocks of a machine.

    Attributes:
        machine: The description, all of whose numbers are parameters.
        closure: How lengths determine the pose.
        guards: What to observe.
        places: Attribute and index of each parameter by its name.
        initial_strokes: Name of the initial strokes in messages, and their attribute.
        iterations: Number of Newton's iterations in an evaluation.
    """

    machine: ClassVar[Machine]
    closure: ClassVar[Closure]
    guards: ClassVar[Guards]
    places: ClassVar[Mapping[str, tuple[str, int | None]]]
    initial_strokes: ClassVar[tuple[str, str]] = ("x_L", "x_L")
    iterations: ClassVar[int] = ITERATIONS
    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    internal_step = Parameter(
        1e-3,
        unit="s",
        minimum=1e-9,
        name="solver.internal_step",
        description="Longest internal integration step (classical Runge-Kutta)",
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require a payload that is not negative, strokes that are not empty, and triangles that close."""
        conditions = {}
        if self.machine.payload is not None:
            conditions["payload.m must not be negative"] = v.payload >= 0.0
        name, attribute = self.initial_strokes
        conditions |= self._closing(v, getattr(v, attribute), f"{name}[{{}}]", with_all=True)
        mechanism = self.mechanism(v)
        for bar in mechanism.bars:
            if bar.slide is not None and not is_zero(distance := mechanism.beside_slide(bar)):
                moved = mechanism.frames[bar.slide].name
                sentence = f"the points of '{bar.name}' must be along the slide of '{moved}', as in the file"
                conditions[sentence] = distance < _BESIDE
        if "screw_q_LB" in vars(type(self)):
            for i, (low, high) in enumerate(zip(v.screw_q_LB, v.screw_q_UB, strict=True), 1):
                conditions[f"the stroke is empty: screw.q_UB[{i}] must be above screw.q_LB[{i}]"] = high > low
            if not self.closure.iterated:
                conditions |= self._closing(v, v.screw_q_LB, "screw.q_LB[{}]")
                conditions |= self._closing(v, v.screw_q_UB, "screw.q_UB[{}]")
        return conditions

    def _closing(self, v: Any, strokes: Sequence[Any], name: str, with_all: bool = False) -> dict[str, Any]:
        """Return conditions that triangles close; `with_all` those whose pins other joints move."""
        dynamics, conditions = self.dynamics(v, strokes), dict[str, Any]()
        frames = dynamics.mechanism.frames
        if with_all:
            conditions |= self.guards.conditions(v, dynamics) | _masses(dynamics)
        for coordinate, change in dynamics.pose.changes.items():
            coordinate_name = frames[dynamics.mechanism.frame_of(coordinate)].name
            conditions[f"start.pose of '{coordinate_name}' must be near the one of the strokes"] = (
                abs(change) < _CLOSE
            )
        for i, bar in enumerate(dynamics.mechanism.actuators, 1):
            lever = dynamics.pose.levers.get(bar.name)
            parents = {frames[bar.start.frame].parent, frames[bar.end.frame].parent}
            if lever is None or not (with_all or parents & {bar.start.frame, bar.end.frame}):
                continue
            slope = plain(lever.slope) * float(self.closure.sides[lever.coordinate])
            stroke = name.format(i)
            conditions[f"the triangle of '{bar.name}' cannot close at the stroke {stroke}"] = slope > 0.0
        return conditions

    def dynamics(self, v: Any, strokes: Sequence[Any]) -> Dynamics:
        """Return the machine's dynamics at strokes in m."""
        mechanism = self.mechanism(v)
        iterated = self.closure.iterated
        guess = dict(zip(iterated, v.pose, strict=True)) if iterated else None
        passive = v.passive_q if mechanism.passive else ()
        load = NONE
        if (payload := self.machine.payload) is not None and payload.has_force:
            x, y, z = [*v.payload_F, ZERO][:3]
            load = (x, y, z)
        return Dynamics(mechanism, self.closure, strokes, passive, guess, self.iterations, load)

    def mechanism(self, v: Any) -> Mechanism:
        """Return the mechanism with the values of an instance."""

        def value(name: str) -> Any:
            attribute, index = self.places[name]
            found = getattr(v, attribute)
            return found if index is None else found[index]

        return assemble(self.machine, value, None if self.machine.payload is None else v.payload)

    def pose_rates(self, v: Any, dynamics: Dynamics, speeds: Sequence[Any]) -> dict[str, Any]:
        """Return the derivatives of the pose: its speeds, and a return to the solution."""
        iterated = self.closure.iterated
        if not iterated:
            return {}
        rates, solution = dynamics.speeds(speeds), dynamics.pose.numbers
        pairs = zip(iterated, v.pose, strict=True)
        return {"pose": [plain(rates[i]) + _CORRECTION * (solution[i] - guess) for i, guess in pairs]}

    def tip(self, dynamics: Dynamics) -> dict[str, Any]:
        """Return the position of the payload in m."""
        end = dynamics.mechanism.payload
        if end is None:
            return {}
        position = dynamics.pose.point(end)[: self.machine.dimensions]
        return {f"tip_{axis}": plain(x) for axis, x in zip(AXES_NAMES, position, strict=False)}


class MachineLoad(MachineBlock):
    """Load forces of a machine for the motion of its actuators."""

    def accelerations(self, v: Any, dynamics: Dynamics) -> tuple[list[Any], list[Any]]:
        """Return speeds and accelerations of strokes and passive coordinates."""
        count = len(v.x_L)
        if not dynamics.mechanism.passive:
            return v.v_L, v.a_L
        speeds = [*v.v_L, *v.passive_v]
        M, h = dynamics.mass_matrix(), dynamics.bias(speeds)
        right = []
        for row, weight, damped in zip(M[count:], h[count:], _damping(v, dynamics), strict=True):
            total = plain(damped - weight)
            for m, a in zip(row, v.a_L, strict=False):
                total = total - m * a
            right.append(total)
        return speeds, [*v.a_L, *solve_symmetric([row[count:] for row in M[count:]], right)]

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the derivatives of the pose and of passive coordinates."""
        if not self.layout().states:
            return {}
        dynamics = self.dynamics(v, v.x_L)
        speeds, accelerations = self.accelerations(v, dynamics)
        return self.pose_rates(v, dynamics, speeds) | _passive(v, dynamics, accelerations)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the forces for the motion, and the position of the payload."""
        dynamics = self.dynamics(v, v.x_L)
        forces = dynamics.inverse(*self.accelerations(v, dynamics))
        return {"F_L": forces[: len(v.x_L)], **self.tip(dynamics), **self.guards.values(dynamics)}


class MachinePlant(MachineBlock):
    """A machine with the mechanics of its actuators: motor torques in, motion out."""

    initial_strokes = ("start.x_L", "x_L_start")
    iterations = 2  # strokes and pose are states of the same integration, so that the guess is close

    def motion(self, v: Any) -> tuple[Dynamics, list[Any], list[Any], list[Any], list[Any]]:
        """Return dynamics, speeds and accelerations of all variables, forces, and reflected inertias."""
        dynamics = self.dynamics(v, v.x_L)
        forces, inertias = screw_forces(v, dynamics.mechanism.actuator_masses)
        damping = _damping(v, dynamics)
        speeds = [*v.v_L, *(v.passive_v if damping else ())]
        forces, inertias = [*forces, *damping], [*inertias, *([ZERO] * len(damping))]
        return dynamics, speeds, dynamics.forward(speeds, forces, inertias), forces, inertias

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return speeds and accelerations of the screws, and the motion of the rest."""
        dynamics, speeds, accelerations, _, _ = self.motion(v)
        rest = self.pose_rates(v, dynamics, speeds) | _passive(v, dynamics, accelerations)
        return {"x_L": v.v_L, "v_L": accelerations[: len(v.x_L)], **rest}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return accelerations, the forces between actuators and machine, the payload's place, and energy."""
        dynamics, speeds, accelerations, forces, inertias = self.motion(v)
        count = len(v.x_L)
        triples = zip(forces[:count], inertias, accelerations, strict=False)
        return {
            "a_L": accelerations[:count],
            "F_L": [force - inertia * a for force, inertia, a in triples],
            **self.tip(dynamics),
            "energy": dynamics.energy(speeds, inertias),
            **self.guards.values(dynamics),
        }


def _masses(dynamics: Dynamics) -> dict[str, Any]:
    """Return the conditions that passive joints move a mass; without, their accelerations are not defined."""
    mechanism, count = dynamics.mechanism, len(dynamics.strokes)
    if not mechanism.passive:
        return {}
    M = dynamics.mass_matrix()
    conditions = dict[str, Any]()
    for row, coordinate in enumerate(mechanism.passive, count):
        name = mechanism.frames[mechanism.frame_of(coordinate)].name
        sentence = f"the passive joint '{name}' moves no mass; give its body, or one that it carries, a mass"
        conditions[sentence] = M[row][row] > _MASSLESS
    return conditions


def _damping(v: Any, dynamics: Dynamics) -> list[Any]:
    """Return the torques or forces of the dampers of passive coordinates."""
    mechanism = dynamics.mechanism
    if not mechanism.passive:
        return []
    return [-(damping * speed) for damping, speed in zip(mechanism.dampings, v.passive_v, strict=True)]


def _passive(v: Any, dynamics: Dynamics, accelerations: Sequence[Any]) -> dict[str, Any]:
    """Return the derivatives of passive coordinates."""
    if not dynamics.mechanism.passive:
        return {}
    return {"passive_q": v.passive_v, "passive_v": accelerations[len(v.x_L) :]}


def attribute_of(name: str) -> str:
    """Return the attribute of a variable by its name."""
    return name.replace(".", "_")

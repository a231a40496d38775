"""The result of a sizing: figures, limits, tolerances and verdicts of joints, for each candidate."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.wording import format_count
from ..frame.report import ReportedResult
from .cycle import Cycle
from .figures import Losses, SizingFigures
from .limits import Unexamined, Utilisation, format_percent
from .motor import Winding
from .tolerances import Tolerances, list_reasons

_MAX_ROWS = 20_000
"""Most rows of a table of a cycle."""


@dataclass(frozen=True)
class JointSizing:
    """One joint with one actuator.

    Attributes:
        joint: Name of the joint.
        actuator: Name of the actuator.
        values: Entries of its data sheet in SI units, currents and voltages as peak values of a phase.
        cycle: Signals over the cycle.
        figures: Figures of the cycle.
        limits: Examined limits, the most used first.
        unexamined: Limits that the data sheet lacks.
        losses: Losses of gearbox and screw in the figures.
        winding: Thermal data of the winding, or what is missing for them.
        rise: Temperature rise of the winding in K over the repeated cycle; None without thermal data.
        required: Whether figures are what the motion requires, because the joint did not follow it in the
            run.
        reason: Why the joint did not follow the motion in the run; None if it did.
        overloaded: Whether the load was more than the motor can make.
        remarks: What limits the validity of the figures.
        tolerances: Draws from the tolerances; None without any.
    """

    joint: str
    actuator: str
    values: Mapping[str, float] = field(repr=False)
    cycle: Cycle = field(repr=False)
    figures: SizingFigures
    limits: Sequence[Utilisation]
    unexamined: Sequence[Unexamined]
    losses: Losses
    winding: Winding | str
    rise: Vector | None = field(repr=False)
    required: bool = False
    reason: str | None = None
    overloaded: bool = False
    remarks: Sequence[str] = ()
    tolerances: Tolerances | None = None

    @property
    def holds(self) -> bool | None:
        """Whether no examined limit is exceeded, in any draw; None if the actuator could not be judged.

        If a joint does not follow its motion although motion and load keep all limits, its controller or the
        step size is the cause, not the actuator.
        """
        within_limits = all(limit.holds for limit in self.limits)
        if self.reason is None:
            return within_limits and (self.tolerances is None or not self.tolerances.failures)
        return False if self.overloaded or (self.required and not within_limits) else None

    @property
    def reasons(self) -> list[str]:
        """Why the actuator does not do the job, or why it could not be judged; without full stops."""
        reasons, study = list_reasons(self.reason, self.limits), self.tolerances
        if study is not None and (failures := study.failures):
            # an example only where the nominal values hold: else their reasons say it already
            draw = max(failures, key=lambda draw: draw.worst)
            example = "" if reasons else f", such as with {study.label(draw)}: {'; '.join(draw.reasons)}"
            reasons.append(study.sentence + example)
        return reasons

    @property
    def verdict(self) -> str:
        """The verdict, as a message."""
        label = f"{self.joint} with {self.actuator}"
        count = len(self.unexamined)
        unexamined = f" {format_count(count, 'limit')} not examined." if count else ""
        worst = f"{self.limits[0].name}, {format_percent(self.limits[0].fraction)} %"
        if self.holds:
            tolerances = ""
            if (study := self.tolerances) is not None:
                use = study.limits(self.limits)[0]
                tolerances = (
                    f" With tolerances, {study.sentence}; most used is {use.worst.name}, "
                    f"{format_percent(use.worst.fraction)} %, with {study.label(use.at)}."
                )
            return f"{label} holds; most used is {worst}.{tolerances}{unexamined}"
        reasons = f"{'; '.join(self.reasons)}."
        if self.holds is None:
            advice = (
                f" Motion and load alone keep all examined limits ({worst}), so that the controller does not "
                "fit: try a smaller --step-size, other --gains or another --controller."
            )
            return f"{label} could not be judged: {reasons}{advice if self.required else ''}"
        return f"{label} does not hold: {reasons}{unexamined}"

    @property
    def record(self) -> dict[str, Any]:
        """Content for `size.json`."""
        return {
            "actuator": self.actuator,
            "holds": self.holds,
            "reasons": self.reasons,
            "figures_from": "reference" if self.required else "run",
            "figures": asdict(self.figures),
            "limits": [{**asdict(limit), "holds": limit.holds} for limit in self.limits],
            "not_examined": [asdict(limit) for limit in self.unexamined],
            "losses": asdict(self.losses),
            "winding": None if isinstance(self.winding, str) else asdict(self.winding),
            "remarks": list(self.remarks),
            **({} if self.tolerances is None else {"tolerances": self.tolerances.record(self.limits)}),
        }

    @property
    def table(self) -> polars.DataFrame:
        """The cycle: time, motion, force, torque, currents, power and temperature rise in SI units.

        Of a cycle with more than 20,000 rows, it has every n-th one; `cycle` has them all.
        """
        cycle = self.cycle
        return polars.DataFrame(
            {
                "joint": [self.joint] * len(cycle.time),
                "time": cycle.time,
                "x_L": cycle.x,
                "v_L": cycle.v,
                "force": cycle.force,
                "tau_m": cycle.torque,
                "omega_m": cycle.omega,
                "current": cycle.current,
                "P_el": cycle.P_el,
                "temperature_rise": cycle.time * np.nan if self.rise is None else self.rise,
            }
        ).gather_every(-(-len(cycle.time) // _MAX_ROWS))


@dataclass(frozen=True)
class Candidate:
    """One actuator of a joint, or the actuators of all joints if none has several candidates.

    Attributes:
        label: Name of the candidate: the file of its actuator.
        joints: Results by joint; empty if the candidate cannot be run.
        problem: Why it cannot be run; None if it can.
        joint: Joint of the actuator; None for those of all joints.
    """

    label: str
    joints: Mapping[str, JointSizing]
    problem: str | None = None
    joint: str | None = None

    @property
    def holds(self) -> bool | None:
        """Whether all joints hold; None if none fails, but one could not be judged."""
        verdicts = [sizing.holds for sizing in self.joints.values()]
        if self.problem is not None or False in verdicts:
            return False
        return None if None in verdicts else True

    @property
    def reasons(self) -> list[str]:
        """Why the candidate falls out, or why it could not be judged; without full stops."""
        if self.problem is not None:
            return [self.problem.removesuffix(".")]
        if self.joint is not None:
            return list(self.joints[self.joint].reasons)
        return [f"{joint}: {text}" for joint, sizing in self.joints.items() for text in sizing.reasons]


@dataclass(frozen=True, repr=False)
class SizeResult(ReportedResult):
    """Whether actuators do the job of a scenario.

    `result["lift"]` is the joint of its first candidate that can be run.

    Attributes:
        name: Name of the scenario.
        candidates: Results by candidate, joint by joint; one for all joints if no joint has several.
        varied: Joints with several candidates.
        ambient: Temperature around the motors in K.
        life: Required life in s; None if it was not stated.
        lead_in: Time in s before the cycles, which does not count.
    """

    name: str
    candidates: Sequence[Candidate]
    varied: Sequence[str]
    ambient: float
    life: float | None
    lead_in: float

    def __getitem__(self, joint: str) -> JointSizing:
        """Return the sizing of a joint.

        Raises:
            CommandError: There is no such joint, or no candidate can be run.
        """
        if joint not in self.joints:
            raise CommandError(f"there is no sizing of a joint '{joint}'.", joint=joint)
        return self.joints[joint]

    @property
    def joints(self) -> Mapping[str, JointSizing]:
        """Each joint with its first candidate that can be run."""
        joints: dict[str, JointSizing] = {}
        for candidate in self.candidates:
            for joint, sizing in candidate.joints.items():
                joints.setdefault(joint, sizing)
        return joints

    @property
    def sizings(self) -> Sequence[tuple[Candidate, JointSizing]]:
        """The joints of all candidates, each with its candidate."""
        return [(candidate, sizing) for candidate in self.candidates for sizing in candidate.joints.values()]

    @property
    def holds(self) -> bool:
        """Whether each joint has a candidate that holds."""
        return {c.joint for c in self.candidates} == {c.joint for c in self.candidates if c.holds}

    @property
    def unjudged(self) -> list[JointSizing]:
        """Joints that could not be judged, with each of their candidates."""
        return [sizing for _, sizing in self.sizings if sizing.holds is None]

    @property
    def record(self) -> dict[str, Any]:
        """Content of `size.json`."""
        return {
            "format": "emla-sizing",
            "scenario": self.name,
            "ambient_K": self.ambient,
            "required_life_s": self.life,
            "varied": list(self.varied),
            "candidates": [
                {
                    "label": candidate.label,
                    "joint": candidate.joint,
                    "holds": candidate.holds,
                    "reasons": candidate.reasons,
                    "joints": {joint: sizing.record for joint, sizing in candidate.joints.items()},
                }
                for candidate in self.candidates
            ],
        }

    @property
    def table(self) -> polars.DataFrame:
        """Utilisation of all limits: candidate, joint, limit, used and permitted value, unit, fraction."""
        rows = [
            (candidate.label, sizing.joint, x.name, x.used, x.limit, x.unit, x.fraction, x.holds, x.source)
            for candidate, sizing in self.sizings
            for x in sizing.limits
        ]
        names = ("candidate", "joint", "limit", "used", "permitted", "unit", "fraction", "holds", "source")
        return polars.DataFrame(rows, schema=names if rows else None, orient="row")

    @property
    def draws(self) -> polars.DataFrame | None:
        """All draws: candidate, joint, values, verdict, and the fraction of each limit; None without any."""
        rows = [
            {
                "candidate": candidate.label,
                "joint": sizing.joint,
                "draw": number,
                **draw.values,
                "holds": draw.holds,
                "reasons": "; ".join(draw.reasons),
                **{limit.name: limit.fraction for limit in draw.limits},
            }
            for candidate, sizing in self.sizings
            for number, draw in enumerate(sizing.tolerances.draws if sizing.tolerances else ())
        ]
        return polars.DataFrame(rows, infer_schema_length=None) if rows else None

    @property
    def cycles(self) -> polars.DataFrame:
        """The cycles of all candidates and joints, see `JointSizing.table`."""
        parts = [
            sizing.table.select(polars.lit(candidate.label).alias("candidate"), polars.all())
            for candidate, sizing in self.sizings
        ]
        return polars.concat(parts) if parts else polars.DataFrame()

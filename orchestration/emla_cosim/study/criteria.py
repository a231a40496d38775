"""The criteria of a joint's verdict: windows, times and thresholds, with defaults that drives use."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..base.errors import CommandError, join_names, suggest_names
from ..base.quantities import read_quantity

ALL_JOINTS = "*"

# the approach from the start is over by then; its errors would hide all others
EVALUATED_AFTER = 0.3
"""Errors and torque count from this time in s after the start, or from settling if that is later."""

TOO_SHORT = f"too short to judge: that takes more than {EVALUATED_AFTER:g} s"


def _make_criterion(default: float, unit: str, meaning: str) -> Any:
    return field(default=default, metadata={"unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class Criteria:
    """The criteria of one joint.

    Position window and window time are those of CiA 402 (IEC 61800-7-201, objects 6067h and 6068h). The
    threshold of a trip says how far a value may exceed a limit of the plant: by a fraction of the limit for
    speed, current, torque and temperature, by a distance for the stroke.
    """

    # larger than the lag of every set of gains that follows its reference at all; a narrower window would
    # hide the lag, as a joint would settle only after the reference has stopped
    position_window: float = _make_criterion(
        1e-3, "m", "Position error within which a joint has settled, and is to stay"
    )
    # 0.2 s: what the slowest built-in controller needs from 1 mm to about its own error (docs/metrics.md)
    window_time: float = _make_criterion(0.2, "s", "How long it has to be within it to have settled")
    # drives trip some per cent beyond a limit, so that a reference can move at it
    over_speed: float = _make_criterion(0.05, "1", "Fraction beyond the largest speed that is a trip")
    # 10 %: the overshoot that a well-damped current loop may have
    over_current: float = _make_criterion(0.1, "1", "Fraction beyond the largest current that is a trip")
    over_torque: float = _make_criterion(
        0.1, "1", "Fraction beyond the motor's torque that is a trip, if the torque is that of the command"
    )
    over_temperature: float = _make_criterion(0.05, "1", "Fraction beyond the permitted rise that is a trip")
    # the end stops begin at the stroke
    over_travel: float = _make_criterion(1e-3, "m", "Distance beyond the stroke that is a trip")
    torque_ripple: float = _make_criterion(
        0.2, "1", "Fraction of the torque limit that noise of the torque may take, rms"
    )


_FIELDS = {f.name: f for f in fields(Criteria)}


def resolve_criteria(joints: Collection[str], values: Mapping[str, float | str]) -> dict[str, Criteria]:
    """Return the criteria of each joint.

    Args:
        joints: Names of all joints.
        values: Values by JOINT.CRITERION: numbers in SI units, or texts with a unit such as "0.5 mm". The
            joint may be `*`; a joint's own value overrides it.

    Raises:
        CommandError: A joint or a criterion does not exist, or a value is invalid.
    """
    # those of all joints first, so that those of one joint override them
    criteria = dict.fromkeys(joints, Criteria())
    for joint_criterion in sorted(values, key=lambda key: not key.startswith(f"{ALL_JOINTS}.")):
        joint, _, name = joint_criterion.rpartition(".")
        if name not in _FIELDS or not joint:
            correction = f"write JOINT.CRITERION, with one of {join_names(_FIELDS)}"
            raise CommandError(
                f"the criterion '{joint_criterion}' does not exist; {correction}.", criterion=joint_criterion
            )
        if joint != ALL_JOINTS and joint not in criteria:
            suggestion = suggest_names(joint, list(criteria)) if criteria else "this system has no joints."
            raise CommandError(
                f"the criterion '{joint_criterion}' names '{joint}', which is not a joint; {suggestion}"
            )
        value = _read_criterion(joint_criterion, values[joint_criterion], _FIELDS[name].metadata["unit"])
        for name_of_joint in criteria if joint == ALL_JOINTS else (joint,):
            criteria[name_of_joint] = replace(criteria[name_of_joint], **{name: value})
    return criteria


def _read_criterion(joint_criterion: str, value: float | str, unit: str) -> float:
    """Return a value in SI units; raise CommandError if it is not a positive, finite number."""
    label = f"the criterion '{joint_criterion}'"
    number = value
    if isinstance(value, str):
        number = read_quantity(value, label, unit)
    number = float(number)
    if not 0.0 < number < float("inf"):
        raise CommandError(
            f"{label} is {value}; it must be a positive, finite number.", criterion=joint_criterion
        )
    return number


def format_length(value: float) -> str:
    """Return a length in m as text with a suitable unit."""
    if value < 1e-3:
        return f"{1e6 * value:.4g} µm"
    return f"{1e3 * value:.4g} mm" if value < 1.0 else f"{value:.4g} m"

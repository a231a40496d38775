"""Read the problem of a user: a file, a table, or single values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import msgspec

from hdrm_fmu.parameters import HdrmParameters
from machine_fmu.optimisation.problem import MotionProblem, Via
from machine_fmu.spline import TrajectoryError

from ...base.errors import CommandError, suggest_names
from ...base.files import read_text
from ...base.table_entries import Location
from ...base.toml_structs import describe, extend_struct, list_given, read_toml
from ...base.values import convert_at, convert_value

_MACHINE = "machine"
_OFF = "off"
"""Value of what does not limit the motion."""

_VIA = re.compile(r"via\[(?P<number>[1-9][0-9]?)\]\.(?P<field>\w+)", re.ASCII)
_CAN_BE_OFF = ("tip_E", "a_LB", "a_UB", "j_LB", "j_UB", "ground_clearance", "body_clearance")
_ELEMENT = re.compile(r"(?P<name>[\w.]+)(\[(?P<element>[123])\])?", re.ASCII)


def load_problem(given: MotionProblem | Mapping[str, Any] | str | Path | None) -> MotionProblem:
    """Return the problem of an object, a table or a file; raise CommandError for an invalid one."""
    if isinstance(given, MotionProblem):
        return given
    if given is None:
        return MotionProblem()
    if isinstance(given, Mapping):
        return _of_table(given, "the problem")
    path = Path(given)
    label = f"the problem '{path}'"
    return _of_table(read_toml(read_text(path, "the problem"), label), label)


def override_values(problem: MotionProblem, texts: Mapping[str, str]) -> MotionProblem:
    """Return the problem with other values.

    Args:
        problem: The problem.
        texts: Values by name (q_E, q_E[3], machine.lift_a, via[1].tip): a number, or several with commas.

    Raises:
        CommandError: A name does not exist, or a value is invalid.
    """
    table = asdict(problem)
    for name, text in texts.items():
        if passed := _VIA.fullmatch(name):
            table["via"] = _with_via(
                table["via"], int(passed["number"]), {passed["field"]: _numbers(name, text)}
            )
            continue
        found = _ELEMENT.fullmatch(name)
        if found is None:
            raise CommandError(f"a problem has no '{name}'; write q_E, q_E[3], machine.lift_a or via[1].tip.")
        inside, field = _place(table, found["name"])
        value = _numbers(name, text)
        if found["element"] is None:
            inside[field] = value
            continue
        before = inside[field]
        if before is None:
            raise CommandError(f"'{name}' = {text}; {field} has no values yet: write three, {field}=1,1,1.")
        if not isinstance(before, (list, tuple)) or isinstance(value, list):
            raise CommandError(f"'{name}' = {text}; an element must be one of three numbers.")
        i = int(found["element"]) - 1
        inside[field] = [*before[:i], value, *before[i + 1 :]]
    return _of_table(table, "the problem")


def _with_via(before: Sequence[Mapping[str, Any]], number: int, values: Mapping[str, Any]) -> list[Any]:
    """Return way-points with other values of one of them, counted from 1, or with a further one."""
    if number > len(before) + 1:
        raise CommandError(f"via[{number}] has no predecessor; the next way-point is via[{len(before) + 1}].")
    old = before[number - 1] if number <= len(before) else {}
    return [*before[: number - 1], {**old, **values}, *before[number:]]


def _place(table: dict[str, Any], name: str) -> tuple[dict[str, Any], str]:
    """Return the table that contains a value, and its name in this table."""
    *first, field = name.split(".")
    inside = table[_MACHINE] if first == [_MACHINE] else table
    if first not in ([], [_MACHINE]) or field not in inside or (not first and field == _MACHINE):
        names = [n for n in table if n != _MACHINE] + [f"{_MACHINE}.{n}" for n in table[_MACHINE]]
        raise CommandError(f"a problem has no '{name}'; {suggest_names(name, names)}")
    return inside, field


def _numbers(name: str, text: str) -> Any:
    if text == _OFF:
        return text
    try:
        values = [float(x) for x in text.split(",")]
    except ValueError as error:
        raise CommandError(
            f"'{name}' = {text}; it must be a number in SI units, or several with commas."
        ) from error
    return values[0] if len(values) == 1 else values


def _read_plain(value: Any, _at: Location, _folder: Path | None) -> Any:
    """Return lists as tuples, and NumPy numbers as Python numbers; `MotionProblem` checks them."""
    plain = value.tolist() if hasattr(value, "tolist") else value
    return tuple(plain) if isinstance(plain, list) else plain


def _read_machine(value: Any, at: Location, folder: Path | None) -> HdrmParameters:
    if not isinstance(value, (Mapping, HdrmParameters)):
        raise CommandError(f"{at.label} is {value!r}; it must be a table of lengths and masses.")
    return convert_at(value, HdrmParameters, at, folder)


def _type_in_file(name: str, hint: Any) -> Any:
    if name == "via":
        return Annotated[Sequence[Via], describe("positions that the tip passes, in order")]
    if name == _MACHINE:
        return Annotated[HdrmParameters, describe("the manipulator", read=_read_machine)]
    return Annotated[hint | Literal["off"] if name in _CAN_BE_OFF else hint, describe(read=_read_plain)]


PROBLEM = extend_struct(
    msgspec.Struct,
    "Problem",
    [
        (name, _type_in_file(name, hint), msgspec.UNSET)
        for name, hint in get_type_hints(MotionProblem).items()
    ],
    "Conditions on the motion of the manipulator, by joint: lift, tilt, telescope.",
)
"""The struct of a file with a problem; entries that it lacks are those of the paper."""


def _of_table(table: Mapping[str, Any], where: str) -> MotionProblem:
    """Return a problem with the values of a table; others are those of the paper."""
    values = list_given(convert_value(table, PROBLEM, where))
    values |= {name: None for name in _CAN_BE_OFF if values.get(name) == _OFF}
    if "via" in values:
        values["via"] = tuple(values["via"])
    try:
        return MotionProblem(**values)
    except TrajectoryError as error:
        raise CommandError(f"{where}: {error}") from error

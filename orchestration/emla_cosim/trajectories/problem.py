"""Read the problem of a user: a file, a table, or single values."""

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from hdrm_fmu.optimisation.problem import MotionProblem, Via
from hdrm_fmu.parameters import HdrmParameters
from hdrm_fmu.spline import TrajectoryError

from ..base.errors import CommandError
from ..base.files import read_text

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
    try:
        table = tomllib.loads(read_text(path, "the problem"))
    except (ValueError, RecursionError) as error:
        raise CommandError(f"the problem '{path}' is not TOML: {error}.") from error
    return _of_table(table, f"the problem '{path}'")


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
        raise CommandError(f"a problem has no '{name}'{_near(name, names)}")
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


def _of_table(table: Mapping[str, Any], where: str) -> MotionProblem:
    """Return a problem with the values of a table; others are those of the paper."""
    _check_names(table, MotionProblem, where)
    values = {name: _value(value) for name, value in table.items() if name != _MACHINE}
    values |= {name: None for name in _CAN_BE_OFF if values.get(name) == _OFF}
    try:
        if _MACHINE in table:
            values[_MACHINE] = _machine(table[_MACHINE], where)
        if "via" in table:
            values["via"] = _via(table["via"], where)
        return MotionProblem(**values)
    except TrajectoryError as error:
        raise CommandError(f"{where}: {error}") from error


def _via(given: object, where: str) -> tuple[Via, ...]:
    if not isinstance(given, (list, tuple)) or not all(isinstance(x, (Via, Mapping)) for x in given):
        raise CommandError(
            f"'via' of {where} is {given!r}; it must be a list of tables, each with tip = [x, y]."
        )
    found = list[Via]()
    for i, one in enumerate(given):
        if isinstance(one, Via):
            found.append(one)
            continue
        _check_names(one, Via, f"'via[{i + 1}]' of {where}")
        if "tip" not in one:
            raise CommandError(f"'via[{i + 1}]' of {where} has no tip; write tip = [x, y], in m from O1.")
        found.append(Via(**{name: _value(value) for name, value in one.items()}))
    return tuple(found)


def _machine(given: object, where: str) -> HdrmParameters:
    if isinstance(given, HdrmParameters):
        return given
    if not isinstance(given, Mapping):
        raise CommandError(f"'{_MACHINE}' of {where} is {given!r}; it must be a table of lengths and masses.")
    _check_names(given, HdrmParameters, f"'{_MACHINE}' of {where}")
    values = {name: _value(value) for name, value in given.items()}
    for name, value in values.items():
        _check_form(f"'{_MACHINE}.{name}' of {where}", value, getattr(HdrmParameters(), name))
    try:
        return HdrmParameters(**values)
    except ValueError as error:
        raise CommandError(f"'{_MACHINE}' of {where}: {error}") from error


def _check_form(label: str, value: Any, usual: Any) -> None:
    """Raise CommandError unless a value has the form of the default: a number, or three."""
    given = value if isinstance(value, tuple) else (value,)
    three = isinstance(usual, tuple)
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in given)
    if not numbers or isinstance(value, tuple) != three or (three and len(given) != len(usual)):
        shown = list(value) if isinstance(value, tuple) else value
        wanted = "three numbers: lift, tilt, telescope" if three else "a number"
        raise CommandError(f"{label} is {shown!r}; it must be {wanted}.")


def _value(value: Any) -> Any:
    """Return lists as tuples, and NumPy numbers as Python numbers."""
    plain = value.tolist() if hasattr(value, "tolist") else value
    return tuple(plain) if isinstance(plain, list) else plain


def _check_names(table: Mapping[str, Any], kind: type, where: str) -> None:
    known = [f.name for f in fields(kind)]
    for name in table:
        if name not in known:
            raise CommandError(f"{where} has the unknown name '{name}'{_near(str(name), known)}")


def _near(name: str, known: list[str]) -> str:
    near = [n for n in known if n.lower() == name.lower()] or difflib.get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else f"; use {', '.join(known)}."

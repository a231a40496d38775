"""Requirements: conditions on the metrics of a run, such as `lift.position_error_m < 2e-5`."""

import math
import operator
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..base.errors import CommandError, join_names, suggest_names

_COMPARISONS = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
_SIGN = re.compile(f"({'|'.join(_COMPARISONS)})")
_WORDS = {"true": True, "false": False}

RENAMED: dict[str, str] = {}
"""Former names of metrics, each with its new name. Registered by the packages that define metrics."""

Figures = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""The content of metrics.json without the run: by kind, by subject, and by name."""


@dataclass(frozen=True)
class Requirement:
    """A condition on a metric, named joint.metric or run.metric."""

    figure: str
    sign: str
    value: float | bool

    def __str__(self) -> str:
        value = str(self.value).lower() if isinstance(self.value, bool) else f"{self.value:.9g}"
        return f"{self.figure} {self.sign} {value}"

    def met_by(self, figure: Any) -> bool:
        """Return whether a value meets the condition. Missing, NaN and values of other types do not."""
        if isinstance(figure, bool) != isinstance(self.value, bool) or not _is_figure(figure):
            return False
        return not math.isnan(figure) and bool(_COMPARISONS[self.sign](figure, self.value))


def split_condition(text: str) -> tuple[str, str, str]:
    """Return the parts of a condition around its comparison; empty ones if it is no condition."""
    left, sign, right, *more = [part.strip() for part in _SIGN.split(text)] + ["", ""]
    return ("", "", "") if any(more) else (left, sign, right)


def parse_requirement(text: str) -> Requirement:
    """Parse a requirement. Raise CommandError for any other text."""
    figure, sign, right = split_condition(text)
    value = _value(right)
    if not figure or value is None:
        raise CommandError(
            f"the requirement '{text}' is invalid. Write METRIC, one of {join_names(_COMPARISONS)}, and a "
            "number, true or false, such as 'lift.position_error_m < 2e-5'.",
            requirement=text,
        )
    if isinstance(value, bool) and sign not in ("==", "!="):
        raise CommandError(
            f"the requirement '{text}' compares with {sign}; use == or != with true and false.",
            requirement=text,
        )
    return Requirement(figure, sign, value)


def check_requirements(requirements: Sequence[Requirement], figures: Figures, run: Mapping[str, Any]) -> None:
    """Check that a run can have the required metrics.

    `figures` are those before the first row. If a kind has none yet, all its names are accepted.

    Raises:
        CommandError: If there is no such metric, or its type does not fit the condition.
    """
    known = flatten_figures(figures, run)
    complete = all(figures.values())
    for required in requirements:
        name = required.figure
        if name not in known:
            if not complete:
                continue
            raise CommandError(
                f"there is no metric '{name}' to require; {suggest_figure(name, known)}", name=name
            )
        if isinstance(known[name], bool) != isinstance(required.value, bool):
            right = "true or false" if isinstance(known[name], bool) else "a number"
            raise CommandError(f"the requirement '{required}' does not fit: {name} is {right}.", name=name)


def suggest_figure(name: str, known: Collection[str]) -> str:
    """Return the end of a message on an unknown metric: its new name, or similar ones."""
    of, _, figure = name.rpartition(".")
    if figure in RENAMED:
        return f"'{figure}' is now called '{of}{'.' if of else ''}{RENAMED[figure]}': docs/metrics.md."
    return suggest_names(name, known)


class UnknownFigureError(CommandError, KeyError):
    """Unknown metric. The message gives the new name of a renamed one."""

    __str__ = Exception.__str__  # KeyError would show the message in quotes


class NamedFigures(dict[str, Any]):
    """Metrics by name. For a former name, `[]` raises UnknownFigureError, a KeyError, with the new name."""

    def __missing__(self, name: str) -> Any:
        if name in RENAMED:
            raise UnknownFigureError(f"there is no metric '{name}'; {suggest_figure(name, self)}", name=name)
        raise KeyError(name)


def describe_unmet(
    requirements: Sequence[Requirement], figures: Figures, run: Mapping[str, Any]
) -> str | None:
    """Return a message on the requirements that are not met, or None if all are met."""
    known = flatten_figures(figures, run) if requirements else {}
    failing = [r for r in requirements if not r.met_by(known.get(r.figure))]
    if not failing:
        return None
    return (
        "requirements not met: "
        f"{'; '.join(f'{r}, but {_format_figure(known.get(r.figure), r)}' for r in failing)}."
    )


def flatten_figures(figures: Figures, run: Mapping[str, Any]) -> dict[str, Any]:
    """Return numbers and Booleans by subject.metric."""
    all_ = [of for kind in figures.values() for of in kind.items()] + [("run", run)]
    return {f"{of}.{name}": value for of, found in all_ for name, value in found.items() if _is_figure(value)}


def _is_figure(value: Any) -> bool:
    return isinstance(value, (bool, int, float))


def _value(text: str) -> float | bool | None:
    """Parse a finite number, true or false. Return None for any other text."""
    if text in _WORDS:
        return _WORDS[text]
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _format_figure(figure: Any, required: Requirement) -> str:
    if figure is None or figure != figure:
        return "it is missing"
    if isinstance(figure, bool):
        return f"it is {str(figure).lower()}"
    short = f"{figure:.6g}"
    return f"it is {repr(figure) if short == f'{required.value:.6g}' else short}"

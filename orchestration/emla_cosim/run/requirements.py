"""Requirements: conditions on the metrics of a run, such as `lift.position_error_m < 2e-5`."""

import math
import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..base.errors import CommandError, join_names
from ..base.patterns import find_name, suggest_full_names

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


def resolve_requirements(
    requirements: Sequence[Requirement], figures: Figures, run: Mapping[str, Any], main: str = ""
) -> list[Requirement]:
    """Return the requirements with the full names of their metrics.

    Args:
        requirements: The requirements as users write them.
        figures: The metrics before the first row. If a kind has none yet, all names are accepted.
        run: The metrics of the run.
        main: The component whose variables need no component's name; empty without one.

    Raises:
        CommandError: If there is no such metric, or its type does not fit the condition.
    """
    values = flatten_figures(figures, run)
    is_complete = all(figures.values())
    return [_resolve(required, values, main, is_complete) for required in requirements]


def _resolve(required: Requirement, values: Mapping[str, Any], main: str, is_complete: bool) -> Requirement:
    name = find_name(required.figure, values, main)
    if name is None and not is_complete:
        return required
    if name is None:
        meant = suggest_full_names(required.figure, values, main)
        raise CommandError(
            f"there is no metric '{required.figure}' to require; {meant}", name=required.figure
        )
    if isinstance(values[name], bool) != isinstance(required.value, bool):
        right = "true or false" if isinstance(values[name], bool) else "a number"
        raise CommandError(f"the requirement '{required}' does not fit: {name} is {right}.", name=name)
    return replace(required, figure=name)


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

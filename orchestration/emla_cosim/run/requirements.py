"""What a run is required to give: conditions on its figures, such as `lift.position_error_m < 2e-5`."""

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
"""Names of figures that older versions had, and what has taken their places; filled by who has figures."""

Figures = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""The content of metrics.json but for the run: by kind, by what they are of, and by name."""


@dataclass(frozen=True)
class Requirement:
    """A figure by its name (joint.figure, or run.figure), and what it is compared with."""

    figure: str
    sign: str
    value: float | bool

    def __str__(self) -> str:
        value = str(self.value).lower() if isinstance(self.value, bool) else f"{self.value:.9g}"
        return f"{self.figure} {self.sign} {value}"

    def met_by(self, figure: Any) -> bool:
        """Whether a figure is as required; one that is missing, NaN or of another kind is not."""
        if isinstance(figure, bool) != isinstance(self.value, bool) or not _is_figure(figure):
            return False
        return not math.isnan(figure) and bool(_COMPARISONS[self.sign](figure, self.value))


def parse_requirement(text: str) -> Requirement:
    """Read one; CommandError for a text that is none."""
    figure, sign, right, *more = [part.strip() for part in _SIGN.split(text)] + ["", ""]
    value = _value(right)
    if any(more) or not figure or value is None:
        raise CommandError(
            f"the requirement '{text}' must be FIGURE, one of {join_names(_COMPARISONS)}, and a number, true "
            "or "
            "false, such as 'lift.position_error_m < 2e-5'.",
            requirement=text,
        )
    if isinstance(value, bool) and sign not in ("==", "!="):
        raise CommandError(
            f"the requirement '{text}' compares by {sign}; true and false take == or !=.",
            requirement=text,
        )
    return Requirement(figure, sign, value)


def check_requirements(requirements: Sequence[Requirement], figures: Figures, run: Mapping[str, Any]) -> None:
    """Raise CommandError for a figure that a run cannot have, or that is no number where one is required.

    `figures` are those before the first row. Where some kind has none yet, any name may still come.
    """
    known = flatten_figures(figures, run)
    complete = all(figures.values())
    for required in requirements:
        name = required.figure
        if name not in known:
            if not complete:
                continue
            raise CommandError(
                f"there is no figure '{name}' to require; {suggest_figure(name, known)}", name=name
            )
        if isinstance(known[name], bool) != isinstance(required.value, bool):
            right = "true or false" if isinstance(known[name], bool) else "a number"
            raise CommandError(f"the requirement '{required}' does not fit: {name} is {right}.", name=name)


def suggest_figure(name: str, known: Collection[str]) -> str:
    """Return what a message says after that there is no such figure: its new name, similar ones, or some."""
    of, _, figure = name.rpartition(".")
    if figure in RENAMED:
        return f"'{figure}' is called '{of}{'.' if of else ''}{RENAMED[figure]}' now: docs/metrics.md."
    return suggest_names(name, known)


class UnknownFigureError(CommandError, KeyError):
    """A figure that there is not, by a name that older versions had."""

    __str__ = Exception.__str__  # KeyError shows its message as Python writes it


class NamedFigures(dict[str, Any]):
    """Figures by name, which know the names that older versions had.

    `figures["converged"]` raises UnknownFigureError, which is a KeyError, with the new name.
    """

    def __missing__(self, name: str) -> Any:
        if name in RENAMED:
            raise UnknownFigureError(f"there is no figure '{name}'; {suggest_figure(name, self)}", name=name)
        raise KeyError(name)


def describe_unmet(
    requirements: Sequence[Requirement], figures: Figures, run: Mapping[str, Any]
) -> str | None:
    """A sentence with all that is not as required, and what it is; None where everything is."""
    known = flatten_figures(figures, run) if requirements else {}
    failing = [r for r in requirements if not r.met_by(known.get(r.figure))]
    if not failing:
        return None
    return (
        "not as required: "
        f"{'; '.join(f'{r}, but {_format_figure(known.get(r.figure), r)}' for r in failing)}."
    )


def flatten_figures(figures: Figures, run: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers and truths by name.figure."""
    all_ = [of for kind in figures.values() for of in kind.items()] + [("run", run)]
    return {f"{of}.{name}": value for of, found in all_ for name, value in found.items() if _is_figure(value)}


def _is_figure(value: Any) -> bool:
    return isinstance(value, (bool, int, float))


def _value(text: str) -> float | bool | None:
    """A finite number, or a truth; None for any other text."""
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

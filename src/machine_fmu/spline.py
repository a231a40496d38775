"""A B-spline of strokes, and its conversion to parameters of a block by `trajectory_block`."""

import json
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .spline_window import COEFFICIENTS, DEGREE, KNOTS

if TYPE_CHECKING:
    import numpy as np

DEFAULT_FILE = Path(__file__).parent / "default_trajectory.json"
"""The file of `default_spline`."""

_LARGEST = 1e9
"""Largest magnitude of a knot in s and of a coefficient in m."""


class TrajectoryError(ValueError):
    """A trajectory or its optimisation problem is wrong."""


@dataclass(frozen=True)
class Spline:
    """Strokes over time as a clamped B-spline: its first and last degree + 1 knots are equal.

    scipy's BSpline(knots, coefficients, degree) is the same curve.

    Args:
        degree: Degree of the polynomials.
        knots: Knots in s, in increasing order.
        coefficients: Coefficients (control points) in m by joint: knots - degree - 1 for each joint.
            Their order is that of the strokes.

    Raises:
        TrajectoryError: A value is not of this form.
    """

    degree: int
    knots: Sequence[float]
    coefficients: Mapping[str, Sequence[float]]

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= DEGREE:
            raise TrajectoryError(f"the degree {reprlib.repr(self.degree)} must be one of 1 to {DEGREE}.")
        _check_numbers("the knots", self.knots)
        self._check_knots()
        if not self.coefficients:
            raise TrajectoryError(
                "there are no coefficients; a trajectory has a list of them for each joint."
            )
        for joint, values in self.coefficients.items():
            _check_numbers(f"the coefficients of {joint}", values)
            if len(values) != self.size:
                raise TrajectoryError(
                    f"there are {len(values)} coefficients of {joint}; {len(self.knots)} knots "
                    f"and degree {self.degree} need {self.size}."
                )

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints in the order of the strokes."""
        return tuple(self.coefficients)

    @property
    def size(self) -> int:
        """Number of coefficients of each joint."""
        return len(self.knots) - self.degree - 1

    @property
    def start(self) -> float:
        """Time of the first knot in s."""
        return self.knots[0]

    @property
    def end(self) -> float:
        """Time of the last knot in s."""
        return self.knots[-1]

    def ordered(self, joints: Sequence[str]) -> "Spline":
        """Return the same motion with the joints in this order.

        Raises:
            TrajectoryError: It is the motion of other joints.
        """
        if set(self.coefficients) != set(joints):
            names = reprlib.repr(list(self.coefficients))
            raise TrajectoryError(f"the coefficients are of {names}; they must be of {', '.join(joints)}.")
        return Spline(self.degree, self.knots, {joint: self.coefficients[joint] for joint in joints})

    def evaluated(self, times: "Iterable[float] | np.ndarray", derivative: int = 0) -> "np.ndarray":
        """Return the strokes in m, or a derivative, at times in s within the knots: one row per time."""
        import numpy as np

        t, knots, degree = np.asarray(times, float), np.asarray(self.knots, float), self.degree
        values = np.column_stack([self.coefficients[joint] for joint in self.joints]).astype(float)
        if derivative > degree:
            return np.zeros((len(t), len(self.joints)))
        for _ in range(derivative):
            spans = (knots[degree + 1 : -1] - knots[1 : -degree - 1])[:, None]
            spans[spans == 0.0] = np.inf  # of coefficients that no time within the knots uses
            values, knots, degree = degree * np.diff(values, axis=0) / spans, knots[1:-1], degree - 1
        first, last = np.searchsorted(knots, knots[0], "right"), np.searchsorted(knots, knots[-1], "left")
        span = np.clip(np.searchsorted(knots, t, "right"), first, last) - 1
        # de Boor's algorithm, which keeps equal coefficients as they are
        points = [values[span - i] for i in range(degree, -1, -1)]
        for width in range(degree, 0, -1):
            shares = [
                ((t - knots[i]) / (knots[i + width] - knots[i]))[:, None]
                for i in (span - j for j in range(width - 1, -1, -1))
            ]
            points = [a + share * (b - a) for (a, b), share in zip(pairwise(points), shares, strict=True)]
        return points[0]

    def _check_knots(self) -> None:
        ends = self.degree + 1
        if len(self.knots) < 2 * ends:
            raise TrajectoryError(
                f"there are {len(self.knots)} knots; degree {self.degree} needs at least {2 * ends}."
            )
        for i, (a, b) in enumerate(zip(self.knots, self.knots[1:], strict=False), 2):
            if b < a:
                raise TrajectoryError(f"knot {i}, {b:.9g} s, is before the previous knot, {a:.9g} s.")
        if self.knots[0] == self.knots[-1]:
            raise TrajectoryError(f"all knots are at {self.knots[0]:.9g} s; the last one must come later.")
        for end_name, end_knots in (("first", self.knots[:ends]), ("last", self.knots[-ends:])):
            if end_knots[0] != end_knots[-1]:
                raise TrajectoryError(
                    f"the {end_name} {ends} knots are not the same; a spline of degree {self.degree} begins "
                    f"and ends with {ends} equal knots here."
                )


def _check_numbers(subject: str, values: Any) -> None:
    """Raise TrajectoryError unless these are finite numbers whose squares cannot overflow."""
    if isinstance(values, (str, bytes, Mapping)) or not hasattr(values, "__len__"):
        raise TrajectoryError(f"{subject} are {reprlib.repr(values)}; they must be a list of numbers.")
    for i, x in enumerate(values, 1):
        is_number = isinstance(x, (int, float)) and not isinstance(x, bool)
        if not is_number or not abs(x) <= _LARGEST:  # also NaN
            value_text = reprlib.repr(x)
            raise TrajectoryError(
                f"number {i} of {subject} is {value_text}; it must be a finite number of at most "
                f"{_LARGEST:g}."
            )


def trajectory_parameters(spline: Spline) -> dict[str, float | int]:
    """Return the parameters of a block with the motion of a spline, by FMI name.

    The last knot and the last coefficients are repeated to fill the arrays.

    Raises:
        TrajectoryError: The spline has more coefficients than the block.
    """
    if spline.size > COEFFICIENTS:
        raise TrajectoryError(
            f"the spline has {spline.size} coefficients per joint; the block of a trajectory has room for "
            f"{COEFFICIENTS}: use fewer knots."
        )
    parameters: dict[str, float | int] = {"degree": spline.degree}
    parameters |= _fill("knot", spline.knots, KNOTS)
    for joint, values in spline.coefficients.items():
        parameters |= _fill(f"coefficient.{joint}", values, COEFFICIENTS)
    return parameters


def _fill(name: str, values: Sequence[float], length: int) -> dict[str, float]:
    # the curve stays the same: spans between equal knots are empty
    padded = [*values, *[values[-1]] * (length - len(values))]
    return {f"{name}[{i}]": float(x) for i, x in enumerate(padded, 1)}


def spline_of(document: object) -> Spline:
    """Return the spline of a trajectory file's content, without its other entries.

    Raises:
        TrajectoryError: The content is not a trajectory.
    """
    if not isinstance(document, Mapping):
        raise TrajectoryError("it must be a JSON object with degree, knots and coefficients.")
    for name in ("degree", "knots", "coefficients"):
        if name not in document:
            raise TrajectoryError(f"it lacks '{name}'; a trajectory has degree, knots and coefficients.")
    degree, knots, coefficients = (document[name] for name in ("degree", "knots", "coefficients"))
    if not isinstance(degree, int) or isinstance(degree, bool):
        raise TrajectoryError(f"the degree {reprlib.repr(degree)} must be a whole number of 1 to {DEGREE}.")
    if not isinstance(coefficients, Mapping):
        raise TrajectoryError("the coefficients must be lists of numbers by joint.")
    return Spline(degree, knots, coefficients)


def default_spline() -> Spline:
    """Return the optimised motion in this package, which is the result of `emla trajectory`."""
    return spline_of(json.loads(DEFAULT_FILE.read_text(encoding="utf-8")))

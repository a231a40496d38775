"""Tolerances of a joint: its results with values at the ends of their ranges, or drawn from them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ...base.wording import format_rounded
from ...system.model import Value
from ..frame.confidence import describe_share, quantile_interval
from .limits import Utilisation

AMBIENT = "ambient"
"""Name of the temperature around the motors, the tolerance that is not one of the runs."""

QUANTILE = 0.95
"""Quantile of the use of a limit in random draws."""


@dataclass(frozen=True)
class Draw:
    """One combination of values within the tolerances, and the result of a joint with it.

    Attributes:
        values: Values by name, in SI units or as factors.
        limits: Examined limits; none if the run failed.
        reason: Why the run failed or the joint did not follow its motion; None if it did.
    """

    values: Mapping[str, Value]
    limits: Sequence[Utilisation]
    reason: str | None

    @property
    def reasons(self) -> list[str]:
        """Why the joint does not hold, without full stops; a joint that could not be judged does not hold."""
        return list_reasons(self.reason, self.limits)

    @property
    def holds(self) -> bool:
        """Whether the joint follows its motion and exceeds no examined limit."""
        return not self.reasons

    @property
    def worst(self) -> float:
        """The largest used fraction of a limit; infinity if the run failed."""
        return max((limit.fraction for limit in self.limits), default=math.inf)


class LimitTolerance(NamedTuple):
    """How much of a limit is used with tolerances.

    Attributes:
        worst: Use in the worst draw.
        at: The worst draw.
        nominal: Used fraction without tolerances; None if the limit is not examined there.
        quantile: Fraction that 95 % of the draws do not exceed.
        quantile_interval: Interval for that of all values, with 95 % confidence.
    """

    worst: Utilisation
    at: Draw
    nominal: float | None
    quantile: float
    quantile_interval: tuple[float, float]

    @property
    def margin(self) -> float:
        """What the worst draw leaves of the limit, as a fraction."""
        return 1.0 - self.worst.fraction


@dataclass(frozen=True)
class Tolerances:
    """The results of a joint in all draws.

    Attributes:
        units: Units of the values by name.
        is_random: Whether the values are random, not the ends of their ranges.
        seed: Seed of random values.
        draws: The draws.
    """

    units: Mapping[str, str]
    is_random: bool
    seed: int
    draws: Sequence[Draw] = field(repr=False)

    @property
    def failures(self) -> list[Draw]:
        """Draws in which the joint does not hold."""
        return [draw for draw in self.draws if not draw.holds]

    @property
    def sentence(self) -> str:
        """How many draws do not hold, and for random ones what follows for all; without full stop."""
        count, total = len(self.failures), len(self.draws)
        if self.is_random:
            return describe_share(count, total, "do not hold")
        return f"{count} of {total} combinations of the ends do not hold"

    def texts(self, draw: Draw) -> list[str]:
        """Return the values of a draw, for people."""
        return [self._format(name, value) for name, value in draw.values.items()]

    def label(self, draw: Draw) -> str:
        """Return the names and values of a draw, for people."""
        return ", ".join(f"{name} = {self._format(name, value)}" for name, value in draw.values.items())

    def _format(self, name: str, value: Value) -> str:
        if name == AMBIENT:
            return f"{format_rounded(float(value) - 273.15, 4)} °C"
        text = format_rounded(value, 4) if isinstance(value, float) else value
        return f"{text} {self.units[name]}".rstrip()

    def limits(self, nominal: Sequence[Utilisation]) -> list[LimitTolerance]:
        """Return the use of each limit, the most used first; `nominal` are the limits without tolerances.

        A run that failed counts as one that uses more than any other.
        """
        nominal_fractions = {limit.name: limit.fraction for limit in nominal}
        uses = list[LimitTolerance]()
        for name in dict.fromkeys(limit.name for draw in self.draws for limit in draw.limits):
            draws = [(limit, draw) for draw in self.draws for limit in draw.limits if limit.name == name]
            worst, at = max(draws, key=lambda use: use[0].fraction)
            failed = [math.inf] * (len(self.draws) - len(draws))
            values = np.array([*(limit.fraction for limit, _ in draws), *failed])
            # "higher": between a number and infinity there is nothing to interpolate
            quantile = float(np.quantile(values, QUANTILE, method="higher"))
            interval = quantile_interval(values, QUANTILE)
            uses.append(LimitTolerance(worst, at, nominal_fractions.get(name), quantile, interval))
        return sorted(uses, key=lambda use: -use.worst.fraction)

    def record(self, nominal: Sequence[Utilisation]) -> dict[str, Any]:
        """Return the entry of `size.json` as plain data; `nominal` are the limits without tolerances."""
        quantiles = ("quantile_95", "quantile_95_interval") if self.is_random else ()
        return {
            "sampling": "random" if self.is_random else "ends",
            "seed": self.seed if self.is_random else None,
            "draws": len(self.draws),
            "not_holding": len(self.failures),
            "sentence": self.sentence,
            "units": dict(self.units),
            "limits": [
                {
                    "name": use.worst.name,
                    "nominal": use.nominal,
                    "worst": use.worst.fraction,
                    "margin": use.margin,
                    "at": dict(use.at.values),
                    **dict(zip(quantiles, (use.quantile, use.quantile_interval), strict=False)),
                }
                for use in self.limits(nominal)
            ],
        }


def list_reasons(reason: str | None, limits: Sequence[Utilisation]) -> list[str]:
    """Return why a joint does not hold: why it did not follow its motion, and the exceeded limits."""
    reasons = [] if reason is None else [reason.removesuffix(".")]
    return [*reasons, *(limit.sentence for limit in limits if not limit.holds)]

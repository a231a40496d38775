"""Confidence intervals of shares and of quantiles from a number of random runs."""

import math

import numpy as np

from ...base.arrays import Vector

LEVEL = 0.95
"""Confidence of all intervals."""


def share_interval(count: int, total: int) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson for the probability of an event.

    If the event never or always occurred, the interval is one-sided.

    Args:
        count: How often it occurred.
        total: Number of independent draws, at least 1.

    References:
        C. J. Clopper and E. S. Pearson, Biometrika 26 (1934), p. 404.
    """
    from scipy.special import betaincinv

    # all of the error is on the one side that is open
    tail = 1.0 - LEVEL if count in (0, total) else 0.5 * (1.0 - LEVEL)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high


def quantile_interval(values: Vector, quantile: float) -> tuple[float, float]:
    """Return an interval for a quantile that assumes no distribution: from one order statistic to another.

    Args:
        values: Independent draws, shape (n,).
        quantile: The quantile, between 0 and 1.

    Returns:
        Both ends; one for which there are too few values is infinite.

    References:
        W. J. Conover, Practical Nonparametric Statistics, 3rd edition (1999), section 3.2.
    """
    from scipy.special import bdtr

    ordered, count = np.sort(values), len(values)
    # the probability that at most 0, 1, ... values are below the quantile
    below = bdtr(np.arange(count), count, quantile)
    tail = 0.5 * (1.0 - LEVEL)
    first = int(np.searchsorted(below, tail, side="right"))
    last = int(np.searchsorted(below, 1.0 - tail, side="left")) + 1
    low = float(ordered[first - 1]) if first > 0 else -math.inf
    return low, float(ordered[last - 1]) if last <= count else math.inf


def describe_share(count: int, total: int, event: str) -> str:
    """Return a message without full stop on how probable an event is, such as a failure.

    Args:
        count: How often it occurred.
        total: Number of independent draws, at least 1.
        event: What occurred, such as "failed".
    """
    low, high = share_interval(count, total)
    confidence = f"with {100.0 * LEVEL:g} % confidence"
    if count == 0:
        return f"0 of {total} {event}: below {_format_percentage(high)} {confidence}"
    if count == total:
        return f"all {total} {event}: above {_format_percentage(low)} {confidence}"
    share, smallest, largest = map(_format_percentage, (count / total, low, high))
    return f"{count} of {total} {event}: {share}, {smallest} to {largest} {confidence}"


def _format_percentage(share: float) -> str:
    if share > 0.9:  # as many digits of what is left, so that only 1 is 100 %
        return f"{100.0 - float(f'{100.0 * (1.0 - share):.2g}'):.10g} %"
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.3g} %"

"""What tests need to know of a block, and helpers to draw points at which it is smooth."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

Draw = Callable[..., Any]


@dataclass
class Point:
    """Values at which to differentiate; no known is zero."""

    values: dict[str, Any]
    time: float = 0.0
    kinks: set[str] = field(default_factory=set)
    """Parameters whose value 0 switches something off: nothing is continuous there."""
    reach: dict[str, float] = field(default_factory=dict)
    """Distance over which a known matters, where that is not its own magnitude."""
    terms: dict[str, float] = field(default_factory=dict)
    """Size of the terms of which an unknown is the sum, where they can cancel each other."""


@dataclass(frozen=True)
class BlockFacts:
    """What tests need to know of one block."""

    start: Mapping[str, Any]
    """Start values at which everything acts that the block has: noise, memory, limits."""
    inputs: Mapping[str, float]
    """Size of every input, in the order of the block."""
    smooth: Mapping[str, Any]
    """Start values, also of inputs, at which outputs are smooth for 0.4 s and none of them rests."""
    points: Callable[[], st.SearchStrategy[Point]]
    """Draws points at which the block can be differentiated."""
    exchange: tuple[float, float] | None = None
    """Stop time and longest internal step in s of the comparison with Model Exchange, from `smooth`.

    Only for blocks with continuous states that have Model Exchange.
    """
    has_model_exchange: bool = True
    """False for blocks that need communication steps."""
    sampled: frozenset[str] = frozenset()
    """Inputs that act at communication points only."""
    still: frozenset[str] = frozenset()
    """Outputs that do not change in the block's reference solution."""
    is_laborious: bool = False
    """Whether the equations are so long that the block runs for a tenth of the time."""


def magnitude(draw: Draw, low: float, high: float) -> float:
    """Draw a value between low and high, every order of magnitude alike."""
    return math.exp(draw(st.floats(math.log(low), math.log(high))))


def signed(draw: Draw, low: float, high: float) -> float:
    """Draw a value whose magnitude is between low and high."""
    return magnitude(draw, low, high) * draw(st.sampled_from([-1.0, 1.0]))


def magnitudes(draw: Draw, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Draw a value for each name, between its low and high."""
    return {name: magnitude(draw, low, high) for name, (low, high) in ranges.items()}


def signs(draw: Draw, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Draw a value for each name, whose magnitude is between its low and high."""
    return {name: signed(draw, low, high) for name, (low, high) in ranges.items()}


def around(draw: Draw, limit: float) -> float:
    """Draw a value that is clearly less than the limit, or clearly more."""
    return limit * draw(st.one_of(st.floats(0.2, 0.7), st.floats(1.4, 4.0)))

"""The search itself: CMA-ES of pycma, which sees nothing but the order of what it tried."""

import math
import warnings
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Vector

_SPREAD = 0.25
"""Standard deviation of the first generation; 1 is the whole range of a gain."""

_INSIDE = 0.02
"""So far from the ends of its range the search begins."""

_ENOUGH = 1e-4
"""A search ends where all that it still tries is as near as this to each other, as a part of the range."""

_NEVER = 10**9

Order = tuple[bool, float]
"""What is compared, less is better: whether it is out of the question; by how much, or how good it is."""


class Search:
    """Points of the unit cube to try, generation by generation, and then again with twice as many at a time.

    The same seed and the same order of what was tried give the same points.
    """

    def __init__(self, start: Sequence[float], seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._dimension = len(start)
        self._begin(np.clip(start, _INSIDE, 1 - _INSIDE), None)

    def ask(self) -> list[Vector]:
        """The next generation."""
        if self._strategy.stop():
            self._begin(self._random.random(self._dimension), 2 * self._strategy.popsize)
        self._asked = self._strategy.ask()
        return [np.array(point) for point in self._asked]

    def tell(self, orders: Sequence[Order]) -> None:
        """How the points of this generation did, in the same order."""
        known = [(bad, math.inf if math.isnan(value) else value) for bad, value in orders]
        places = {order: place for place, order in enumerate(sorted(set(known)))}
        self._strategy.tell(self._asked, [float(places[order]) for order in known])

    def _begin(self, start: Vector, size: int | None) -> None:
        import cma  # takes a while

        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: self._random.standard_normal(shape),
            "seed": math.nan,  # or it would seed NumPy for everybody
            "tolx": _ENOUGH,
            # of places, not of values, these would mean nothing
            "tolfun": 0,
            "tolfunhist": 0,
            "tolfunrel": 0,
            "tolflatfitness": _NEVER,
            "tolstagnation": _NEVER,
            "verbose": -9,
            "verb_log": 0,
            **({} if size is None else {"popsize": size}),
            **({"maxstd": math.inf} if len(start) == 1 else {}),  # cma raises where it limits the only one
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of one dimension, which works
            self._strategy = cma.CMAEvolutionStrategy(start.tolist(), _SPREAD, options)

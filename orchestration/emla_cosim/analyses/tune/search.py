"""The search: CMA-ES of pycma, which uses only the order of the tried points."""

import math
import warnings
from collections.abc import Sequence

import numpy as np

from ...base.arrays import Vector

_SPREAD = 0.25
"""Standard deviation of the first generation; 1 is the whole range of a gain."""

_INSIDE = 0.02
"""Least distance of the first point from the ends of its range."""

_ENOUGH = 1e-4
"""Tolerance of convergence (`tolx` of CMA-ES), as a part of the range."""

_NEVER = 10**9

Order = tuple[bool, float]
"""Sort key of a point, smaller is better: whether it is invalid; then its violation or its objective."""


class Search:
    """Points of the unit cube to try, by generation; each restart doubles the size of a generation.

    The same seed and the same order of tried points give the same points.
    """

    def __init__(self, start: Sequence[float], seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._dimension = len(start)
        self._begin(np.clip(start, _INSIDE, 1 - _INSIDE), None)

    def ask(self) -> list[Vector]:
        """Return the next generation."""
        if self._strategy.stop():
            self._begin(self._random.random(self._dimension), 2 * self._strategy.popsize)
        self._asked = self._strategy.ask()
        return [np.array(point) for point in self._asked]

    def tell(self, orders: Sequence[Order]) -> None:
        """Take the sort keys of the points of this generation, in the same order."""
        known = [(bad, math.inf if math.isnan(value) else value) for bad, value in orders]
        places = {order: place for place, order in enumerate(sorted(set(known)))}
        self._strategy.tell(self._asked, [float(places[order]) for order in known])

    def _begin(self, start: Vector, size: int | None) -> None:
        import cma  # slow to import

        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: self._random.standard_normal(shape),
            "seed": math.nan,  # any number would seed the global generator of NumPy
            "tolx": _ENOUGH,
            # CMA-ES sees ranks, for which tolerances of values mean nothing
            "tolfun": 0,
            "tolfunhist": 0,
            "tolfunrel": 0,
            "tolflatfitness": _NEVER,
            "tolstagnation": _NEVER,
            "verbose": -9,
            "verb_log": 0,
            **({} if size is None else {"popsize": size}),
            **({"maxstd": math.inf} if len(start) == 1 else {}),  # cma raises if this limits one dimension
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one dimension works
            self._strategy = cma.CMAEvolutionStrategy(start.tolist(), _SPREAD, options)

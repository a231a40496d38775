"""Samplings: choose the variants of a sweep from the distributions of its factors."""

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, check_choice
from ...base.values import convert_value
from ...system.model import Value
from .kinds import Distribution

Columns = list[list[Value | None]]
"""For each factor its value in each variant; None for the nominal value."""


@dataclass(frozen=True)
class Sampling:
    """A way to choose variants.

    Attributes:
        draw: Returns the values from distributions, runs and seed.
        count: Returns the number of variants from distributions and runs. Default: the runs.
        own_size: For samplings without runs: what determines their size. `runs` is 0 then.
    """

    draw: Callable[[Sequence[Distribution], int, int], Columns]
    count: Callable[[Sequence[Distribution], int], int] = lambda _, runs: runs
    own_size: str = ""


def count_variants(method: str, distributions: Sequence[Distribution], runs: int | None) -> int:
    """Return the number of variants of a sampling, without drawing them.

    Raises:
        CommandError: As for `sample`, except for the seed.
    """
    return _find_sampling(method, distributions, runs).count(distributions, runs or 0)


def sample(method: str, distributions: Sequence[Distribution], runs: int | None, seed: int) -> Columns:
    """Draw the values of all variants.

    - `grid` takes all combinations of levels. The last distribution changes fastest.
    - `one-at-a-time` takes the nominal variant, then the low and high end of each distribution with all
      others nominal.
    - `random`, `latin-hypercube` and `sobol` (scrambled) draw `runs` variants.
    - `saltelli` draws `runs` base samples with len(distributions) + 2 variants each: a row of a matrix A,
      the same with each value in turn from a matrix B, and the row of B.

    `grid` and `one-at-a-time` have no `runs`. `sobol` and `saltelli` converge best with a power of two. The
    same seed gives bitwise the same values.

    Args:
        method: A name of `SAMPLINGS`.
        distributions: One for each factor.
        runs: Number of runs or base samples.
        seed: Whole number from 0.

    Returns:
        For each distribution a list with a value for each variant; None for the nominal value.

    Raises:
        CommandError: An argument is invalid, or a distribution has no levels for a grid (its position is in
            the field `index`).
    """
    sampling = _find_sampling(method, distributions, runs)
    if convert_value(seed, int, "the seed") < 0:
        raise CommandError(f"the seed {seed} must be a whole number from 0.", seed=seed)
    return sampling.draw(distributions, runs or 0, int(seed))


def _find_sampling(method: str, distributions: Sequence[Distribution], runs: Any) -> Sampling:
    """Return a sampling by name; raise CommandError if it cannot draw this number of runs."""
    check_choice("sampling", method, SAMPLINGS)
    sampling = SAMPLINGS[method]
    if not distributions:
        raise CommandError("nothing varies; a sampling needs at least one distribution.")
    if sampling.own_size:
        if runs is not None:
            raise CommandError(
                f"the sampling '{method}' does not accept a number of runs: {sampling.own_size}.",
                method=method,
                runs=runs,
            )
    elif runs is None:
        raise CommandError(f"the sampling '{method}' needs a number of runs, 1 or more.", method=method)
    elif convert_value(runs, int, "the number of runs") < 1:
        raise CommandError(f"the number of runs is {runs}; it must be 1 or more.", runs=runs)
    return sampling


def _map_quantiles(distributions: Sequence[Distribution], quantiles: Vector) -> Columns:
    return [list(d.at(column)) for d, column in zip(distributions, quantiles.T, strict=True)]


def _count_grid_points(distributions: Sequence[Distribution], _runs: int) -> int:
    """Return the number of combinations; raise CommandError for a distribution without levels."""
    for i, distribution in enumerate(distributions):
        if distribution.level_count is None:
            raise CommandError(
                f"a grid needs levels, but {distribution.noun}, number {i + 1} of the factors, has none; "
                "add points or values, or choose another sampling such as latin-hypercube.",
                index=i,
            )
    return math.prod(d.level_count or 0 for d in distributions)


def _draw_grid(distributions: Sequence[Distribution], _runs: int, _seed: int) -> Columns:
    _count_grid_points(distributions, 0)
    rows = list(itertools.product(*(d.levels or () for d in distributions)))
    return [[row[i] for row in rows] for i in range(len(distributions))]


def _draw_random(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    return _map_quantiles(distributions, np.random.default_rng(seed).random((runs, len(distributions))))


def _draw_latin_hypercube(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    from scipy.stats import qmc  # takes a second, which a grid does not need

    return _map_quantiles(distributions, qmc.LatinHypercube(len(distributions), rng=seed).random(runs))


def _draw_sobol_points(dimensions: int, runs: int, seed: int) -> Vector:
    from scipy.stats import qmc

    # a whole power of two, of which the first are used: SciPy warns about any other number
    return qmc.Sobol(dimensions, rng=seed).random_base2((runs - 1).bit_length())[:runs]


def _draw_sobol(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    return _map_quantiles(distributions, _draw_sobol_points(len(distributions), runs, seed))


def _draw_saltelli(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    """Draw for each base sample the row of A, A with each value of B in turn, and the row of B."""
    factors = len(distributions)
    base = _draw_sobol_points(2 * factors, runs, seed)  # two matrices A and B, side by side
    rows = np.repeat(base[:, None, :factors], factors + 2, axis=1)
    for i in range(factors):
        rows[:, 1 + i, i] = base[:, factors + i]
    # the last row is B itself
    rows[:, -1] = base[:, factors:]
    return _map_quantiles(distributions, rows.reshape(-1, factors))


def _draw_one_at_a_time(distributions: Sequence[Distribution], _runs: int, _seed: int) -> Columns:
    rows = 2 * len(distributions) + 1
    columns: Columns = [[None] * rows for _ in distributions]
    for i, distribution in enumerate(distributions):
        columns[i][2 * i + 1 : 2 * i + 3] = distribution.ends
    return columns


SAMPLINGS: dict[str, Sampling] = {
    "grid": Sampling(_draw_grid, _count_grid_points, own_size="a grid is as large as its levels make it"),
    "random": Sampling(_draw_random),
    "latin-hypercube": Sampling(_draw_latin_hypercube),
    "sobol": Sampling(_draw_sobol),
    "saltelli": Sampling(_draw_saltelli, lambda distributions, runs: runs * (len(distributions) + 2)),
    "one-at-a-time": Sampling(
        _draw_one_at_a_time,
        lambda distributions, _: 2 * len(distributions) + 1,
        own_size="it runs the nominal variant and two for each factor",
    ),
}
"""Samplings by name; `sample` describes them."""

LARGEST_SEED = 2**31 - 2
"""The largest seed."""


def draw_seeds(entropy: int | list[int], count: int, without: Collection[int] = ()) -> list[int]:
    """Draw different seeds. The same entropy gives the same sequence, of which `count` is the length.

    Args:
        entropy: Seed of the draw itself.
        count: Number of seeds.
        without: Seeds to exclude.

    Returns:
        Whole numbers from 1 to `LARGEST_SEED` - 1.
    """
    random, seeds = np.random.default_rng(entropy), dict[int, None]()
    # one by one, so that more seeds continue the same sequence
    while len(seeds) < count:
        if (drawn := int(random.integers(1, LARGEST_SEED))) not in without:
            seeds[drawn] = None
    return list(seeds)

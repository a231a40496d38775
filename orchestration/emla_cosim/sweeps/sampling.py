"""Samplings: which variants a sweep runs, by the distributions of what varies."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError, check_choice
from ..base.values import convert_value
from ..system.model import Value
from .distributions import Distribution

_MOST_SOBOL_RUNS = 2**30
"""SciPy's Sobol sequence has this many points."""

_MOST_SOBOL_DIMENSIONS = 21201
"""Directions of Sobol's sequence that are known."""

Columns = list[list[Value | None]]
"""For each thing that varies its value in each variant; None where it has its nominal one."""


@dataclass(frozen=True)
class Sampling:
    """A way to choose variants.

    `count` says how many there are, by distributions and runs; `draw` gives them, by these and a seed. Where
    the user gives no runs, `own_size` says what decides instead, and runs are 0. `dimensions` are those of a
    Sobol sequence for each thing that varies; 0 where none is drawn.
    """

    count: Callable[[Sequence[Distribution], int], int]
    draw: Callable[[Sequence[Distribution], int, int], Columns]
    own_size: str = ""
    dimensions: int = 0

    @property
    def takes_runs(self) -> bool:
        """Whether it is the user who says how many variants there are."""
        return not self.own_size


def count_variants(method: str, distributions: Sequence[Distribution], runs: int | None) -> int:
    """How many variants a sampling has; nothing is allocated for them.

    Raises CommandError as `sample` does, but for a wrong seed.
    """
    return _check_method(method, distributions, runs).count(distributions, _runs(runs))


def sample(
    method: str, distributions: Sequence[Distribution], runs: int | None, seed: int
) -> list[list[Value | None]]:
    """For each distribution its values, one for each variant; None stands for the nominal value.

    `method` is one of `SAMPLINGS`. `grid` takes all combinations of levels, the last distribution's fastest;
    `one-at-a-time` the nominal variant, then for each distribution its low and its high end with everything
    else nominal. These two take no `runs` and draw nothing. `random`, `latin-hypercube` and `sobol`
    (scrambled) draw `runs` variants. `saltelli` draws `runs` base points and makes len(distributions) + 2
    variants of each, in the order that SALib.analyze.sobol takes without second order. `sobol` and `saltelli`
    converge best with a power of two. The same seed, a whole number from 0, gives the same values to the bit.

    Raises CommandError for an unknown method, no distributions, wrong or missing runs, a negative seed, too
    many dimensions for Sobol's sequence, and, with the field `index`, for one without levels in a grid.
    """
    sampling = _check_method(method, distributions, runs)
    if convert_value(seed, int, "the seed") < 0:
        raise CommandError(f"the seed {seed} must be a whole number from 0.", seed=seed)
    return sampling.draw(distributions, _runs(runs), int(seed))


def _check_method(method: str, distributions: Sequence[Distribution], runs: Any) -> Sampling:
    check_choice("sampling", method, SAMPLINGS)
    sampling = SAMPLINGS[method]
    if not distributions:
        raise CommandError("nothing varies; a sampling needs one distribution or more.")
    if sampling.takes_runs:
        _check_runs(method, runs, sampling)
    elif runs is not None:
        raise CommandError(
            f"the sampling '{method}' takes no number of runs: {sampling.own_size}.", method=method, runs=runs
        )
    if sampling.dimensions * len(distributions) > _MOST_SOBOL_DIMENSIONS:
        most = _MOST_SOBOL_DIMENSIONS // sampling.dimensions
        raise CommandError(
            f"the sampling '{method}' can vary {most} things at most, for Sobol's sequence has no more; "
            f"here are {len(distributions)}.",
            method=method,
        )
    return sampling


def _check_runs(method: str, runs: Any, sampling: Sampling) -> None:
    if runs is None:
        raise CommandError(f"the sampling '{method}' needs a number of runs, 1 or more.", method=method)
    if convert_value(runs, int, "the number of runs") < 1:
        raise CommandError(f"the number of runs is {runs}; it must be 1 or more.", runs=runs)
    if sampling.dimensions and runs > _MOST_SOBOL_RUNS:
        raise CommandError(
            f"the sampling '{method}' has {_MOST_SOBOL_RUNS} runs at most, the length of Sobol's sequence; "
            f"here are {runs}.",
            runs=runs,
        )


def _runs(runs: int | None) -> int:
    return 0 if runs is None else int(runs)


def _generator(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def _at(distributions: Sequence[Distribution], quantiles: Vector) -> Columns:
    return [list(d.at(column)) for d, column in zip(distributions, quantiles.T, strict=True)]


def _grid_count(distributions: Sequence[Distribution], _runs: int) -> int:
    sizes = []
    for i, distribution in enumerate(distributions):
        size = distribution.level_count
        if size is None:
            raise CommandError(
                f"a grid needs levels, and {distribution.noun}, number {i + 1} of what varies, has none; "
                "give points or values, or choose another sampling such as latin-hypercube.",
                index=i,
            )
        sizes.append(size)
    return math.prod(sizes)


def _grid(distributions: Sequence[Distribution], _runs: int, _seed: int) -> Columns:
    """Each level as often as there are combinations of what follows, as often as of what comes before."""
    rows, before = _grid_count(distributions, 0), 1
    columns = Columns()
    for distribution in distributions:
        levels = distribution.levels or ()
        after = rows // (before * len(levels))
        columns.append([level for level in levels for _ in range(after)] * before)
        before *= len(levels)
    return columns


def _random(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    return _at(distributions, _generator(seed).random((runs, len(distributions))))


def _latin_hypercube(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    from scipy.stats import qmc  # takes a second, which a grid does without

    return _at(distributions, qmc.LatinHypercube(len(distributions), rng=_generator(seed)).random(runs))


def _sobol(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    from scipy.stats import qmc

    engine = qmc.Sobol(len(distributions), rng=_generator(seed))
    return _at(distributions, engine.random_base2(_exponent(runs))[:runs])


def _saltelli(distributions: Sequence[Distribution], runs: int, seed: int) -> Columns:
    from SALib.sample import sobol

    names = [str(i) for i in range(len(distributions))]
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    size = 2 ** _exponent(runs)  # what is cut off again keeps SciPy from warning
    points = sobol.sample(problem, size, calc_second_order=False, seed=_generator(seed))
    return _at(distributions, points[: _saltelli_count(distributions, runs)])


def _saltelli_count(distributions: Sequence[Distribution], runs: int) -> int:
    return runs * (len(distributions) + 2)


def _exponent(runs: int) -> int:
    """Of the power of two that is no less."""
    return (runs - 1).bit_length()


def _one_at_a_time(distributions: Sequence[Distribution], _runs: int, _seed: int) -> Columns:
    rows = 2 * len(distributions) + 1
    columns: Columns = [[None] * rows for _ in distributions]
    for i, distribution in enumerate(distributions):
        columns[i][2 * i + 1 : 2 * i + 3] = distribution.ends
    return columns


def _sample_given(_distributions: Sequence[Distribution], runs: int) -> int:
    return runs


SAMPLINGS: dict[str, Sampling] = {
    "grid": Sampling(_grid_count, _grid, own_size="a grid is as large as its levels make it"),
    "random": Sampling(_sample_given, _random),
    "latin-hypercube": Sampling(_sample_given, _latin_hypercube),
    "sobol": Sampling(_sample_given, _sobol, dimensions=1),
    "saltelli": Sampling(_saltelli_count, _saltelli, dimensions=2),
    "one-at-a-time": Sampling(
        lambda distributions, _: 2 * len(distributions) + 1,
        _one_at_a_time,
        own_size="it runs the nominal variant and two for each thing that varies",
    ),
}
"""Samplings by name; `sample` says what each does."""

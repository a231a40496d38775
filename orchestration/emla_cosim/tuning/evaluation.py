"""Sets of gains tried on a farm of workers: every case with every seed."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..sweeps.factors import Factor
from ..sweeps.farm import Farm, Work
from ..sweeps.measures import Measures
from ..sweeps.targets import merged
from ..sweeps.worker import Chunk, Outcome, Variant
from .score import Judge, Score


@dataclass
class Evaluation:
    """Tries gains; `cases` has the options of each case, `seeds` the start values that are seeds."""

    farm: Farm
    judge: Judge
    measures: Measures
    cases: Sequence[Mapping[str, Any]]
    seeds: Factor | None
    interrupted: Callable[[], bool]
    runs: int = 0
    _numbers: Any = field(default_factory=itertools.count)

    def scores(
        self, candidates: Sequence[Mapping[str, Any]], seeds: Sequence[int | None]
    ) -> list[Score] | None:
        """What each of these options is worth on these seeds; None where somebody ended it meanwhile.

        A seed None leaves the scenario's. Raises RunError where the cluster is gone.
        """
        variants = {
            next(self._numbers): merged([gains, self._seeded(seed), case])
            for gains, case, seed in itertools.product(candidates, self.cases, seeds)
        }
        outcomes = dict[int, Outcome]()

        def keep(chunk: Chunk) -> None:
            outcomes.update({outcome.number: outcome for outcome in chunk.outcomes})

        def variant(number: int) -> Variant:
            return Variant(number, variants[number])

        work = [Work(0, list(variants))]
        if not self.farm.run(work, variant, self.measures, 0, keep, self.interrupted):
            return None
        self.runs += len(variants)
        ordered = iter(variants)
        return [
            self.judge.score([[outcomes[next(ordered)] for _ in seeds] for _ in self.cases])
            for _ in candidates
        ]

    def _seeded(self, seed: int | None) -> dict[str, Any]:
        return {} if seed is None or self.seeds is None else self.seeds.options(seed)

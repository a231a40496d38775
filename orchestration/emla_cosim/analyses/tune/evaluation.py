"""Evaluate sets of gains on workers: every case with every seed."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..execution.executor import Executor, WorkPackage
from ..variants.data import Chunk, Variant, VariantOutcome
from ..variants.factors import Factor
from ..variants.measures import Measures
from ..variants.targets import merge_options
from .loop_margins import LoopMargins
from .score import Objective, Score
from .step_influence import HalvedScore, score_halved


@dataclass
class Evaluation:
    """Evaluates gains; `cases` has the options of each case, `seeds` the start values that are seeds.

    The margins of `loops`, one entry for each case, are measured for gains that meet all other conditions.
    """

    executor: Executor
    objective: Objective
    measures: Measures
    cases: Sequence[Mapping[str, Any]]
    seeds: Factor | None
    interrupted: Callable[[], bool]
    loops: Sequence[LoopMargins | None] = ()
    runs: int = 0
    _numbers: Any = field(default_factory=itertools.count)

    def scores(
        self, candidates: Sequence[Mapping[str, Any]], seeds: Sequence[int | None]
    ) -> list[Score] | None:
        """Return the score of each candidate on these seeds; None after an interrupt.

        Args:
            candidates: The options of each set of gains.
            seeds: Seeds of the random sequences; None keeps those of the scenario.

        Raises:
            RunError: The cluster is lost.
        """
        outcomes = self._run(candidates, seeds)
        if outcomes is None:
            return None
        found = list[Score]()
        for gains, ours in zip(candidates, outcomes, strict=True):
            if any(self.loops) and self.objective.meets_measured(ours):
                if self.interrupted():
                    return None
                ours = self._with_margins(gains.get("set", {}), ours)
            found.append(self.objective.score(ours))
        return found

    def halve_step(self, gains: Mapping[str, Any], seeds: Sequence[int | None]) -> HalvedScore | None:
        """Return the score of gains with half the step, without margins of loops; None after an interrupt.

        Args:
            gains: The options of the gains.
            seeds: As for `scores`.

        Raises:
            RunError: The cluster is lost.
        """
        outcomes = self._run([gains], seeds, is_halved=True)
        return None if outcomes is None else score_halved(self.objective, outcomes[0])

    def _run(
        self, candidates: Sequence[Mapping[str, Any]], seeds: Sequence[int | None], is_halved: bool = False
    ) -> list[list[list[VariantOutcome]]] | None:
        """Return the outcomes of each candidate by case and seed; None after an interrupt."""
        variants = {
            next(self._numbers): merge_options([gains, self._with_seed(seed), case])
            for gains, case, seed in itertools.product(candidates, self.cases, seeds)
        }
        outcomes = dict[int, VariantOutcome]()

        def keep(chunk: Chunk) -> None:
            outcomes.update({outcome.number: outcome for outcome in chunk.outcomes})

        def variant(number: int) -> Variant:
            return Variant(number, variants[number], is_halved)

        work = [WorkPackage(0, list(variants))]
        if not self.executor.run(work, variant, self.measures, 0, keep, self.interrupted):
            return None
        self.runs += len(variants)
        ordered = iter(variants)
        return [[[outcomes[next(ordered)] for _ in seeds] for _ in self.cases] for _ in candidates]

    def _with_margins(
        self, gains: Mapping[str, Any], outcomes: Sequence[Sequence[VariantOutcome]]
    ) -> list[list[VariantOutcome]]:
        """Return the outcomes of all cases with the margins of their loops, the same for each seed."""
        found = list[list[VariantOutcome]]()
        for loops, ours in zip(self.loops, outcomes, strict=True):
            margins = {} if loops is None else loops.measure(gains)
            found.append([replace(one, figures={**one.figures, **margins}) for one in ours])
        return found

    def _with_seed(self, seed: int | None) -> dict[str, Any]:
        return {} if seed is None or self.seeds is None else self.seeds.options(seed)

"""Held-out seeds: random sequences that no tuning has seen, the same for every controller."""

import tomllib
from collections.abc import Mapping, Sequence
from zlib import crc32

from ..run.scenarios.built_in import TUNINGS
from ..study.randomness import SEED, is_random
from ..sweeps.factors import find_start_number, find_start_values
from ..sweeps.seeds import draw_seeds
from ..sweeps.worker_payload import Preparation
from ..system.model import Value

_ENTROPY = 26
"""Of the draw of held-out seeds; any number but those of the tuning plans would do."""


class HeldOutSeeds:
    """Seeds that the plans of the built-in tunings neither train nor validate with; `drawn` has `count`."""

    def __init__(self, count: int) -> None:
        self._without = list_tuning_seeds()
        self.drawn = draw_seeds(_ENTROPY, count, self._without)

    def values(self, names: Sequence[str], seed: int) -> dict[str, Value]:
        """Return the start values that one of them means for random sequences, by full name.

        Each sequence has its own, by its name alone: so every controller meets the same ones.
        """
        return {name: draw_seeds([seed, crc32(name.encode())], 1, self._without)[0] for name in names}


def list_tuning_seeds() -> set[int]:
    """Return the seeds that the plans of the built-in tunings train and validate with."""
    plans = [tomllib.loads(text()) for text in TUNINGS.values()]
    return {
        seed for plan in plans for seed in draw_seeds(plan["seed"], plan["training"] + plan["validation"])
    }


def random_seeds(prepared: Preparation, values: Mapping[str, Value], fixed: Mapping[str, Value]) -> list[str]:
    """Return the full names of the seeds whose sequences reach anything in a run.

    Args:
        prepared: The system.
        values: Start values of the run beside those of the system, by full name.
        fixed: Start values that were set by hand: a seed among them stays.
    """

    def value(name: str) -> float | None:
        return (
            float(values[name])
            if name in values
            else find_start_number(name, prepared.system, prepared.interfaces)
        )

    names = find_start_values(SEED, prepared.system, prepared.interfaces)
    return [name for name in names if name not in fixed and is_random(name, value)]

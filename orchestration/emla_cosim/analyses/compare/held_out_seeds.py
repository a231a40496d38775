"""Held-out seeds: random sequences that no tuning used, the same for every controller."""

from collections.abc import Mapping, Sequence
from zlib import crc32

from ...base.toml_structs import read_toml
from ...run.scenarios.built_in import TUNINGS
from ...study.randomness import SEED, is_random
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..variants.factors import find_start_values
from ..variants.sampling import draw_seeds

_ENTROPY = 26
"""Seed of the draw of held-out seeds; any number that no tuning plan uses would do."""


class HeldOutSeeds:
    """Seeds that the plans of the built-in tunings use neither for training nor for validation."""

    def __init__(self, count: int) -> None:
        self._without = list_tuning_seeds()
        self.drawn = draw_seeds(_ENTROPY, count, self._without)

    def values(self, names: Sequence[str], seed: int) -> dict[str, Value]:
        """Return the start values of the random sequences for one held-out seed, by full name.

        The seed of a sequence depends on its name alone, so every controller meets the same sequences.
        """
        return {name: draw_seeds([seed, crc32(name.encode())], 1, self._without)[0] for name in names}


def list_tuning_seeds() -> set[int]:
    """Return the seeds that the plans of the built-in tunings train and validate with."""
    plans = [read_toml(text(), name) for name, text in TUNINGS.items()]
    return {
        seed for plan in plans for seed in draw_seeds(plan["seed"], plan["training"] + plan["validation"])
    }


def random_seeds(prepared: Preparation, values: Mapping[str, Value]) -> list[str]:
    """Return the full names of the seeds of sequences that affect a run.

    Args:
        prepared: The system.
        values: Start values of the run, by full name; they override those of the system.
    """
    names = Names(prepared.system, prepared.interfaces)

    def value(name: str) -> float | None:
        return float(values[name]) if name in values else names.find(name).start_number

    seeds = find_start_values(SEED, prepared.system, prepared.interfaces)
    return [name for name in seeds if is_random(name, value)]

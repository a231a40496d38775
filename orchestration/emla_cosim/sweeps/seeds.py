"""Seeds for the random generators of FMUs."""

from collections.abc import Collection

import numpy as np

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
    random, found = np.random.default_rng(entropy), dict[int, None]()
    while len(found) < count:
        if (drawn := int(random.integers(1, LARGEST_SEED))) not in without:
            found[drawn] = None
    return list(found)

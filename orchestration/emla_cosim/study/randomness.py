"""Random sequences in the components of a joint: their seeds, and whether they have any effect."""

from collections.abc import Callable, Mapping

from ..base.wording import matches_pattern

SEED = "*.seed"
"""Pattern of the start values that seed random sequences."""

MAGNITUDES: Mapping[str, tuple[str, ...]] = {
    "d_2.seed": ("d_2.low", "d_2.high"),
    "sensor.seed": ("sensor.sigma",),
    "sensor.current.seed": ("sensor.current.sigma",),
}
"""Start values that scale a random sequence, by the end of its seed's name.

Two are the ends of a uniform distribution, one is a standard deviation.
"""


def is_random(seed: str, value: Callable[[str], float | None]) -> bool:
    """Return whether a sequence has any effect; sequences that are not ours count as effective.

    Args:
        seed: Full name of the seed.
        value: Returns a start value by full name, or None if it is unknown.
    """
    # a sequence of equal ends, or of zero deviation, is the same for any seed
    for end, scales in MAGNITUDES.items():
        if seed.endswith(f".{end}"):
            prefix = seed.removesuffix(end)
            low, high = [0.0, *(value(f"{prefix}{scale}") for scale in scales)][-2:]
            return low is None or high is None or low != high
    return True


def find_seeds(parameters: Mapping[str, float]) -> list[str]:
    """Return the full names of the seeds of sequences that have an effect, from all parameters."""
    return [name for name in parameters if matches_pattern(name, SEED) and is_random(name, parameters.get)]

"""What is random in the components of a joint: the seeds of sequences, and whether these reach anything."""

from collections.abc import Callable, Mapping

SEED = "*.seed"
"""Pattern of the start values that begin random sequences."""

MAGNITUDES: Mapping[str, tuple[str, ...]] = {
    "d_2.seed": ("d_2.low", "d_2.high"),
    "sensor.seed": ("sensor.sigma",),
    "sensor.current.seed": ("sensor.current.sigma",),
}
"""By the end of a seed's name those of the values beside it that its sequence is scaled with.

Two are the ends of a uniform distribution, one is a standard deviation.
"""


def is_random(seed: str, value: Callable[[str], float | None]) -> bool:
    """Return whether a sequence reaches anything; of one that is not ours that is taken for granted.

    Args:
        seed: Full name of the seed.
        value: Returns a start value by full name, None where it is not known.
    """
    for end, scales in MAGNITUDES.items():
        if seed.endswith(f".{end}"):
            place = seed.removesuffix(end)
            low, high = [0.0, *(value(f"{place}{scale}") for scale in scales)][-2:]
            return low is None or high is None or low != high
    return True

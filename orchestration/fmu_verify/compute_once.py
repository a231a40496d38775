"""Share one result between several processes."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def compute_once(place: Path, do: Callable[[], T]) -> T:
    """Call `do` in the first process that asks, and return its result in all of them.

    If `do` raises, the next process tries.

    Args:
        place: File for the result, which is unpickled. Other users must not be able to write to its folder.
        do: Function to call.
    """
    from filelock import FileLock  # its handlers of forks cost all processes a millisecond

    place.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(place.with_suffix(".lock")):
        if place.is_file():
            return pickle.loads(place.read_bytes())
        answer = do()
        place.write_bytes(pickle.dumps(answer))
        return answer

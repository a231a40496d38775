"""What several processes want, and one of them does."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from filelock import FileLock

T = TypeVar("T")


def compute_once(place: Path, do: Callable[[], T]) -> T:
    """What `do` returns, by the first process that asks for it at this file; others wait, and read it.

    Where `do` raises, the next one tries. The folder has to be one that nobody else may write to.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(place.with_suffix(".lock")):
        if place.is_file():
            return pickle.loads(place.read_bytes())
        answer = do()
        place.write_bytes(pickle.dumps(answer))
        return answer

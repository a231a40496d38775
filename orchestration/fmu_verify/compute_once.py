"""Share one result between several processes."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def compute_once(path: Path, compute: Callable[[], T]) -> T:
    """Call `compute` in the first process that asks, and return its result in all of them.

    If `compute` raises, the next process tries.

    Args:
        path: File for the result, which is unpickled. Its folder is created if it is missing; other users
            must not be able to write to it.
        compute: Function to call.
    """
    from filelock import FileLock  # its handlers of forks cost all processes a millisecond

    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        if path.is_file():
            return pickle.loads(path.read_bytes())
        answer = compute()
        path.write_bytes(pickle.dumps(answer))
        return answer

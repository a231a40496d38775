"""Error messages of systems that cannot be run, without the command."""

from pathlib import Path
from typing import Any

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.study.loading import load


def problem_of(system: Any, *words: str, **options: Any) -> str:
    """Load, prepare and run a system; return the message with which that ends.

    The message is one line that contains all words in this order.
    """
    path = str(system) if isinstance(system, Path) else system
    with pytest.raises(CommandError) as caught:
        load(path, **{"stop_time": 0.2, "step_size": 0.1, **options}).prepare().run()
    message = rest = str(caught.value)
    assert "\n" not in message and message[-1] in ".?", message
    for word in words:
        assert word in rest, (word, message)
        rest = rest[rest.index(word) + len(word) :]
    return message

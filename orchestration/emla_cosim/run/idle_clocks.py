"""Describe triggered clocks that nothing triggers."""

from collections.abc import Sequence

from ..base.errors import join_names


def describe_idle_clocks(names: Sequence[str]) -> list[str]:
    """Return a remark on triggered input clocks without a connection.

    Args:
        names: Their full names.
    """
    if not names:
        return []
    clocks = "triggered clock" if len(names) == 1 else "triggered clocks"
    return [f"No output clock is connected to the {clocks} {join_names(names)}, which therefore never tick."]

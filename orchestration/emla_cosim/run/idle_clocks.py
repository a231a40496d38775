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
    what = "clock {}: it never ticks" if len(names) == 1 else "clocks {}: they never tick"
    return [f"No output clock is connected to the triggered {what.format(join_names(names))}."]

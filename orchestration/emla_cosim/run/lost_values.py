"""Describe start values that FMUs did not take."""

from collections.abc import Mapping
from typing import Any

from ..base.wording import format_count

_NAMED = 3
"""Most values that a remark names."""

_LOST = "did not take"


def tells_lost_values(text: str | None) -> bool:
    """Return whether a text contains a remark of `describe_lost_values`."""
    return f" {_LOST} " in (text or "")


def describe_lost_values(record: Mapping[str, Any]) -> list[str]:
    """Return a remark for each component whose FMU did not take all start values.

    Args:
        record: The content of run.json.
    """
    found = []
    for component, entries in record["components"].items():
        if lost := entries["not_taken"]:
            values = [_describe(name, value) for name, value in lost.items()][:_NAMED]
            rest = f"; and {len(lost) - _NAMED} more" if len(lost) > _NAMED else ""
            count = format_count(len(lost), "start value")
            found.append(f"The FMU of {component} {_LOST} {count}: {'; '.join(values)}{rest}.")
    return found


def _describe(name: str, value: Mapping[str, Any]) -> str:
    unit = f" {value['unit']}" if value["unit"] else ""
    if value["read"] is None:
        return f"{name} was set to {value['set']}{unit} and cannot be read"
    return f"{name} is {value['read']}{unit} instead of {value['set']}{unit}"

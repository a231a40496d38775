"""Remarks on a run: its start values, clocks, event mode and signals."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..base.errors import join_names
from ..base.wording import format_count
from ..fmu.elements import BINARY
from ..system.model import System
from ..system.names import NamedVariable

MOST = 50
"""Most signals that are recorded without being asked for."""

_MOST_NAMES = 3
"""Most start values that a remark names."""

_REJECTED = "did not take"


def has_lost_values_remark(text: str | None) -> bool:
    """Return whether a text contains a remark of `describe_lost_values`."""
    return f" {_REJECTED} " in (text or "")


def describe_lost_values(record: Mapping[str, Any]) -> list[str]:
    """Return a remark for each component whose FMU did not take all start values.

    Args:
        record: The content of run.json.
    """
    remarks = []
    for component, entries in record["components"].items():
        if rejected := entries["not_taken"]:
            values = [_describe_rejected_value(name, value) for name, value in rejected.items()][:_MOST_NAMES]
            rest = f"; and {len(rejected) - _MOST_NAMES} more" if len(rejected) > _MOST_NAMES else ""
            count = format_count(len(rejected), "start value")
            remarks.append(f"The FMU of {component} {_REJECTED} {count}: {'; '.join(values)}{rest}.")
    return remarks


def _describe_rejected_value(name: str, value: Mapping[str, Any]) -> str:
    unit = f" {value['unit']}" if value["unit"] else ""
    if value["read"] is None:
        return f"{name} was set to {value['set']}{unit} and cannot be read"
    return f"{name} is {value['read']}{unit} instead of {value['set']}{unit}"


def describe_unscheduled_clocks(names: Sequence[str]) -> list[str]:
    """Return a remark on triggered input clocks without a connection, by their full names."""
    if not names:
        return []
    clause = "clock {}: it never ticks" if len(names) == 1 else "clocks {}: they never tick"
    return [f"No output clock is connected to the triggered {clause.format(join_names(names))}."]


def describe_disabled_event_mode(system: System) -> list[str]:
    """Return a remark on the components that run without event mode, if there are any."""
    names = [c.name for c in system.components if not c.event_mode]
    if not names:
        return []
    run = "runs" if len(names) == 1 else "run"
    return [f"{join_names(names)} {run} without event mode, as the option 'no_event_mode' says."]


def choose_fallback_signals(candidates: Iterable[NamedVariable]) -> tuple[list[str], str]:
    """Return what to record where no FMU has an output of a number, with a remark on it.

    These are the continuous states, else the local variables, at most `MOST`.

    Args:
        candidates: Variables that the option `signals` can name.
    """
    variables = [v for v in candidates if v.variable.type not in ("String", BINARY)]
    rates = [(v.component.name, v.variable.derivative) for v in variables]
    states = {(component, state.name) for component, state in rates if state is not None}
    of_kind = {
        "continuous states": [v.full_name for v in variables if v.end in states],
        "local variables": [v.full_name for v in variables if str(v.variable.causality) == "local"],
    }
    reason = "No FMU has an output of a number"
    for kind, names in of_kind.items():
        if names:
            few = f"the first {MOST} of the {len(names)} {kind}" if len(names) > MOST else f"the {kind}"
            return names[:MOST], f"{reason}; {few} are recorded instead. Set --signals to choose."
    return (
        [],
        f"{reason}, a state or a local variable; only `time` is recorded. Set --signals to record others.",
    )

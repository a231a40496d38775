"""Run FMUs of FMI 3.0 without event mode, and describe that and clocks that never tick."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..base.errors import CommandError, join_names
from ..fmu.interface import CO_SIMULATION, KINDS, Interface
from ..system.model import Component, System


def disable_event_mode(system: System, names: Sequence[str], interfaces: Mapping[str, Interface]) -> System:
    """Return the system with components that run without event mode; those that have none are skipped.

    Args:
        system: The system, with the kinds as which its FMUs run.
        names: The components.
        interfaces: The model description of each component.

    Raises:
        CommandError: If none of them has event mode, or one has clocks, which tick in event mode only.
    """
    able = [n for n in names if _has_event_mode(system.component(n), interfaces[n])]
    if not able:
        raise CommandError(
            f"no FMU has event mode in co-simulation among {join_names(names)}; change the option "
            "'no_event_mode'."
        )
    for name in able:
        if clocks := interfaces[name].clocks:
            raise CommandError(
                f"{name} cannot run without event mode: its FMU has the clock '{clocks[0]}'. In the option "
                "'no_event_mode', name other components only.",
                component=name,
            )
        system = system.with_component(replace(system.component(name), event_mode=False))
    return system


def describe_disabled_event_mode(system: System) -> list[str]:
    """Return a remark on the components that run without event mode, if there are any."""
    names = [c.name for c in system.components if not c.event_mode]
    if not names:
        return []
    run = "runs" if len(names) == 1 else "run"
    return [f"{join_names(names)} {run} without event mode, as the option 'no_event_mode' says."]


def describe_idle_clocks(names: Sequence[str]) -> list[str]:
    """Return a remark on triggered input clocks without a connection.

    Args:
        names: Their full names.
    """
    if not names:
        return []
    what = "clock {}: it never ticks" if len(names) == 1 else "clocks {}: they never tick"
    return [f"No output clock is connected to the triggered {what.format(join_names(names))}."]


def _has_event_mode(component: Component, interface: Interface) -> bool:
    kind = KINDS.get(component.kind) or next(iter(interface.kinds))
    return kind == CO_SIMULATION and bool(getattr(interface.kinds[kind], "hasEventMode", False))

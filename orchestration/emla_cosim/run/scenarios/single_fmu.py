"""Run one FMU as a system: name of its component, and times."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...fmu.interface import Interface, read_interface
from ...system.model import Component, System
from ..options import Options
from .default_times import choose_times, read_times

_LONGEST = 60
"""Most letters of a component's name."""


@dataclass(frozen=True)
class SingleFmu:
    """An FMU that runs alone: name of its component, description, system and times in s.

    `notes` are remarks on times that the FMU does not have, or that do not fit each other.
    """

    name: str
    description: str
    system: System
    times: Mapping[str, float]
    notes: tuple[str, ...]


def make_single_fmu(path: Path, options: Options) -> SingleFmu:
    """Make a system of one FMU. Times in the options override its own.

    Raises:
        CommandError: If the file is no FMU, or this master cannot run it.
    """
    interface = read_interface(path)
    name = make_component_name(str(interface.description.modelName))
    times, notes = _times(interface, options)
    description = " ".join(str(interface.description.description or "").split())
    return SingleFmu(name, description, System((Component(name, fmu=path),), ()), times, tuple(notes))


def make_component_name(model: str) -> str:
    """Return the component name for a model: the last part of its name, with _ for other signs than letters.

    `Modelica.Blocks.PID 2` is `PID_2`.
    """
    name = re.sub(r"\W+", "_", model.rpartition(".")[2])[:_LONGEST].strip("_")
    return name if name and not name[0].isdigit() else f"model_{name}".strip("_")


def _times(interface: Interface, options: Options) -> tuple[dict[str, float], list[str]]:
    """Return start, stop and step of the default experiment, and remarks on missing ones."""
    said = read_times(interface)
    times, notes = choose_times(said, options, "FMU")
    start, stop, step = times.start or 0.0, times.stop or 0.0, times.step or 0.0
    chosen = (options.start_time, options.stop_time, options.step_size)
    if chosen == (None, None, None) and step == said.step and not _whole(stop - start, step):
        fitting = (stop - start) / math.ceil((stop - start) / step)
        notes.append(f"its steps of {step:g} s do not end at {stop:g} s; the run uses steps of {fitting:g} s")
        step = fitting
    return {"start_time": start, "stop_time": stop, "step_size": step}, notes


def _whole(span: float, step: float) -> bool:
    return abs(round(span / step) * step - span) <= 1e-9 * span

"""The supply that several joints share: its component, its connections, and its figures of a run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from emla_fmu import SharedSupply
from emla_fmu.shared_supply import JOINTS

from ..base.arrays import Vector, read_stored_array
from ..base.errors import CommandError
from ..recorders.metrics import Figures, MetricDisplay, Metrics
from ..recorders.recorder import RunLayout
from ..run.options import Options
from ..system.model import Component, System, Value
from .actuator.model_parameters import get_number
from .joint import DRIVES

SUPPLY = "supply"
"""Name of the component."""

_SAG = "supply.sag"
_U_MAX = "inverter.u_max"

_CHOPPER, _LOW, _HIGH = 1.15, 0.5, 1.3
"""Voltages at which the chopper begins, and at which drives trip, relative to the link without load; assumed,
of the size of 650, 300 and 750 V on a link of 565 V."""


def supply_components(
    joints: Mapping[str, float], values: Mapping[str, Value]
) -> tuple[tuple[Component, ...], tuple[str, ...]]:
    """Return the component of a supply, and its connections with the drives of joints.

    Its voltage without load is the one with which the inverter with the longest vector reaches that vector.

    Args:
        joints: Longest voltage vectors in V by the name of the component with the drive, such as
            `lift.plant`: a plant, or the electrical half of one.
        values: Start values that replace the defaults, by FMI name.

    Raises:
        CommandError: There are no joints, or more than a supply has.
    """
    if not 1 <= len(joints) <= JOINTS:
        raise CommandError(
            f"a shared supply is for 1 to {JOINTS} joints with our plants, but this system has {len(joints)}."
        )
    # space-vector modulation reaches 1 / sqrt(3) of the link
    u_0 = math.sqrt(3.0) * max(joints.values())
    levels = {"link.u_start": 1.0, "source.u_0": 1.0, "chopper.u_on": _CHOPPER, "link.u_low": _LOW}
    parameters: dict[str, Value] = {n: factor * u_0 for n, factor in {**levels, "link.u_high": _HIGH}.items()}
    wires = list[str]()
    for i, (drive, u_max) in enumerate(joints.items(), 1):
        parameters[f"joint.u_max[{i}]"] = u_max
        wires += [f"{drive}.P_el -> {SUPPLY}.joint.P_el[{i}]", f"{SUPPLY}.{_SAG}[{i}] -> {drive}.{_SAG}"]
    component = Component(SUPPLY, SharedSupply.__name__, {**parameters, **values}, note=_describe_supply)
    return (component,), tuple(wires)


def share_supply(system: System, values: Mapping[str, Value] | None = None) -> System:
    """Return a system whose joints share a supply, which keeps the sags of their disturbances.

    Args:
        system: A built-in system.
        values: Start values of the supply that replace the defaults, by FMI name.

    Raises:
        CommandError: It has no joints, or more than a supply has.
    """
    models = {block.__name__ for block in DRIVES}
    drives = [c for c in system.components if c.model in models]
    joints = {c.name: float(c.parameters[_U_MAX]) for c in drives}
    components, wires = supply_components(joints, values or {})
    sags = list[str]()
    for i, drive in enumerate(joints, 1):
        sags += [
            f"{x.source}.{x.output} -> {SUPPLY}.joint.sag[{i}]" for x in system.into(drive) if x.input == _SAG
        ]
    extended = replace(system, components=(*system.components, *components))
    return extended.with_connections(*sags, *wires)


def complete_order(system: System, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the option `order` with a shared supply at its end; empty if nothing is to be added.

    Args:
        system: The system.
        options: Options of the algorithm that are set.
    """
    order = list[str](options.get("order") or ())
    if not order or SUPPLY in order or all(c.name != SUPPLY for c in system.components):
        return {}
    # it needs the power of all drives
    return {"order": [*order, SUPPLY]}


def _describe_supply(system: System) -> str:
    """Return the remark on the supply of a system."""
    parameters = system.component(SUPPLY).parameters
    return (
        f"{SUPPLY} has {float(parameters['source.u_0']):.4g} V without load; its capacitor, resistances and "
        f"chopper are assumed, set {SUPPLY}.link.C, {SUPPLY}.source.R and {SUPPLY}.chopper.R"
    )


def remarks(system: System, options: Options) -> list[str]:
    """Return a warning, without full stop, for each inverter whose voltage the supply does not have."""
    warnings = list[str]()
    for x in system.out_of(SUPPLY):
        u_max = f"joint.u_max{x.output.removeprefix(_SAG)}"
        drive = get_number(system, options, x.target, _U_MAX)
        supply = get_number(system, options, SUPPLY, u_max)
        if None not in (drive, supply) and drive != supply:
            warnings.append(
                f"{x.target}.{_U_MAX} is {drive:g} V, but {SUPPLY}.{u_max} is {supply:g} V; set both to the "
                "same voltage"
            )
    return warnings


@dataclass
class SupplyFigures:
    """The supply's part of metrics.json; docs/metrics.md defines each figure."""

    source_energy_J: float
    source_loss_J: float
    drawn_energy_J: float
    regenerated_energy_J: float
    reused_energy_J: float
    burnt_energy_J: float
    stored_energy_J: float
    lowest_voltage_V: float
    highest_voltage_V: float


_ENERGIES = ("source.energy", "source.loss", "joint.drawn", "joint.returned", "chopper.energy", "link.stored")
_VOLTAGE = "link.u"


def create_supply_metrics(layout: RunLayout) -> "SupplyMetrics | None":
    """Return the metrics of a run's shared supply; None without one."""
    column = {name: i + 1 for i, name in enumerate(layout.names)}
    names = [f"{SUPPLY}.{name}" for name in (*_ENERGIES, _VOLTAGE)]
    if not all(name in column for name in names):
        return None
    return SupplyMetrics([column[name] for name in names])


class SupplyMetrics(Metrics):
    """Energies at the end of a run, and extremes of the voltage."""

    displays = (
        MetricDisplay("source_energy_J", "energy from the source", 1e-3, "kJ"),
        MetricDisplay("regenerated_energy_J", "regenerated energy", 1e-3, "kJ"),
        MetricDisplay("reused_energy_J", "reused energy", 1e-3, "kJ"),
        MetricDisplay("burnt_energy_J", "energy burnt in the chopper", 1e-3, "kJ"),
        MetricDisplay("lowest_voltage_V", "lowest voltage", 1.0, "V"),
        MetricDisplay("highest_voltage_V", "highest voltage", 1.0, "V"),
    )

    def __init__(self, columns: Sequence[int]) -> None:
        """Take the columns of the energies and of the voltage in the rows."""
        self._columns = list(columns)
        self._energies = np.full(len(_ENERGIES), np.nan)
        self._lowest = self._highest = np.nan

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        *energies, voltage = rows.T[self._columns]
        self._energies = np.array([energy[-1] for energy in energies])
        self._lowest = float(np.fmin(self._lowest, voltage.min()))
        self._highest = float(np.fmax(self._highest, voltage.max()))

    def figures(self) -> Figures:
        """Return the figures of the supply."""
        supplied, loss, drawn, returned, burnt, stored = self._energies.tolist()
        figures = SupplyFigures(
            source_energy_J=supplied,
            source_loss_J=loss,
            drawn_energy_J=drawn,
            regenerated_energy_J=returned,
            # what is still in the capacitor has not been used
            reused_energy_J=max(returned - burnt - max(stored, 0.0), 0.0),
            burnt_energy_J=burnt,
            stored_energy_J=stored,
            lowest_voltage_V=self._lowest,
            highest_voltage_V=self._highest,
        )
        return {SUPPLY: vars(figures)}

    def state_dict(self) -> Any:
        """Return the state as plain data."""
        return {"energies": self._energies.tolist(), "voltages": [self._lowest, self._highest]}

    def load_state_dict(self, state: Any) -> None:
        """Continue from `state`; raise KeyError or ValueError if it belongs to another run."""
        self._energies = read_stored_array(state["energies"], (len(_ENERGIES),))
        self._lowest, self._highest = read_stored_array(state["voltages"], (2,)).tolist()

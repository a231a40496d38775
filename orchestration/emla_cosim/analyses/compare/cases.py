"""Cases in which controllers are compared, read from files, and their start values in a system."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

from ...base.toml_structs import read_toml
from ...system.fault import Fault
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..variants.factors import find_start_values


@dataclass(frozen=True)
class ComparisonCase:
    """A case of a comparison: start values to set and to scale, by pattern, and faults.

    Attributes:
        start_error: Distance in m between the screw and the start of its reference; None keeps that of the
            scenario.
        fault: Faults of signals, with * for the joint.
        at: The coordinates of a point on a map.
    """

    name: str = "nominal"
    set: Mapping[str, Value] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    start_error: float | None = None
    fault: Sequence[Mapping[str, Any]] = ()
    at: tuple[float, float] | None = None

    def faults(self, joints: Sequence[str]) -> list[Fault]:
        """Return the faults of this case for each of the joints."""
        return [
            Fault(**{**entry, "signal": entry["signal"].replace("*", joint, 1)})
            for joint in joints
            for entry in self.fault
        ]

    def resolve_start_values(self, prepared: Preparation) -> dict[str, Value] | None:
        """Return the start values of the case by full name; None if the system has no such variable."""
        fixed = [dict.fromkeys(_find_start_values(name, prepared), value) for name, value in self.set.items()]
        scaled = [_scale_values(pattern, factor, prepared) for pattern, factor in self.scale.items()]
        shifted = [] if self.start_error is None else [_shift_start(self.start_error, prepared)]
        # values to set must all exist; of those to scale, a joint may have some only
        if not all((*fixed, *shifted)) or (scaled and not any(scaled)):
            return None
        return {name: value for change in (*fixed, *scaled, *shifted) for name, value in change.items()}


@dataclass(frozen=True)
class MapAxis:
    """One axis of a map: the variables that it sets or scales, from `low` to `high`, in `unit`."""

    label: str
    low: float
    high: float
    set: Sequence[str] = ()
    scale: Sequence[str] = ()
    unit: float = 1.0

    def levels(self, count: int) -> list[float]:
        """Return the coordinates of this many points."""
        return [self.low + (self.high - self.low) * number / (count - 1) for number in range(count)]


@dataclass(frozen=True)
class StabilityMap:
    """A grid of cases over two axes."""

    name: str
    x: MapAxis
    y: MapAxis

    def cases(self, resolution: int) -> list[ComparisonCase]:
        """Return a case for each point, row by row."""
        return [
            ComparisonCase(
                f"{self.name}: {x:.4g}, {y:.4g}",
                {name: at * axis.unit for axis, at in ((self.x, x), (self.y, y)) for name in axis.set},
                {name: at * axis.unit for axis, at in ((self.x, x), (self.y, y)) for name in axis.scale},
                at=(x, y),
            )
            for y in self.y.levels(resolution)
            for x in self.x.levels(resolution)
        ]


def read_robustness_cases() -> list[ComparisonCase]:
    """Return the cases of the table `robustness`."""
    return [ComparisonCase(**entry) for entry in _read("robustness")["case"]]


def read_stability_maps() -> list[StabilityMap]:
    """Return the maps of the table `stability`."""
    return [StabilityMap(m["name"], MapAxis(**m["x"]), MapAxis(**m["y"])) for m in _read("stability")["map"]]


def read_stability_stop_time() -> float:
    """Return the default stop time of the runs of maps, in s."""
    return float(_read("stability")["stop_time"])


def _read(name: str) -> dict[str, Any]:
    return read_toml((files("emla_cosim.study") / "cases" / f"{name}.toml").read_text(encoding="utf-8"), name)


def _find_start_values(pattern: str, prepared: Preparation) -> dict[str, float | None]:
    return find_start_values(pattern, prepared.system, prepared.interfaces)


def _scale_values(pattern: str, factor: float, prepared: Preparation) -> dict[str, Value]:
    """Return the values that match a pattern times the factor, limited to the bounds of each variable."""
    scaled, names = dict[str, Value](), Names(prepared.system, prepared.interfaces)
    for name, value in _find_start_values(pattern, prepared).items():
        if value is not None:
            declared = names.find(name).variable
            # an FMU may refuse a start value beyond its bounds
            low = -math.inf if declared.min is None else float(declared.min)
            high = math.inf if declared.max is None else float(declared.max)
            scaled[name] = min(max(factor * value, low), high)
    return scaled


def _shift_start(error: float, prepared: Preparation) -> dict[str, Value]:
    """Return start values that move plants and observers `error` in m away from their reference."""
    shifted = dict[str, Value]()
    for name, start in _find_start_values("*.reference.waypoint[1]", prepared).items():
        joint = name.removesuffix(".reference.waypoint[1]")
        for state in ("plant.start.x_L", "observer.start.x_hat"):
            if start is not None and _find_start_values(f"{joint}.{state}", prepared):
                shifted[f"{joint}.{state}"] = start + error
    return shifted

"""Types of the options that Python takes as keyword arguments.

Type checkers know a wrong name or value from them. Each function refuses the options that it does not take.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ..base.option import FileOrObject
from ..base.tolerances import Tolerance
from ..inputs.input import Input
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.step_size_control import StepSizeControl
from ..system.fault import Fault
from ..system.model import Replacement, Value

_Path = str | Path
_Time = float | str | None


class CompareOptions(TypedDict, total=False):
    """Options of `compare`."""

    set: Mapping[str, Value | np.generic | Sequence[Value] | NDArray[Any]]
    replace: Mapping[str, Replacement | _Path | Mapping[str, Any]]
    input: Sequence[Input | _Path | Mapping[str, Any]]
    mode: str | None
    load_control: str | None
    supply: bool
    notch: Mapping[str, float | str]
    actuator: Mapping[str, _Path | FileOrObject]
    sheet: Mapping[str, Value]
    fault: Sequence[Fault | str | Mapping[str, Any]]
    trajectory: _Path | None
    parameters: Sequence[_Path]
    mapping: Mapping[str, _Path]
    follow_models: bool
    kind: Mapping[str, str]
    no_event_mode: Sequence[str] | bool
    integrate_together: bool
    isolate: Sequence[str] | bool
    lenient: bool
    flavour: str
    fmus: _Path | None
    stop_time: _Time
    step_size: _Time
    algorithm: str | Algorithm
    start_time: _Time
    stop_when: Sequence[str]
    fmi_tolerance: float | None
    integrator: str
    integrator_step: _Time
    step_size_control: str | StepSizeControl | None
    estimate_coupling: bool
    output_interval: _Time
    roles: Mapping[str, str]
    criteria: Mapping[str, float | str]
    bonds: Mapping[str, str]
    timeout: _Time
    patience: float | str
    extrapolation: str
    step_multiples: Mapping[str, int]
    order: Sequence[str]
    coupling_tolerance: float
    error_tolerance: float | None
    largest_step: _Time


class TuneOptions(CompareOptions, total=False):
    """Options of `tune`."""

    controller: str | type | None
    gains: str | None


class SweepOptions(TuneOptions, total=False):
    """Options of `sweep` and `identify`."""

    require: Sequence[str]


class RunOptions(SweepOptions, total=False):
    """Options of functions that load, prepare or run a scenario."""

    platform: Sequence[str]
    fmi: int
    inputs: Sequence[str]
    outputs: Sequence[str]
    components: Sequence[str]
    precision: str
    threads: int | None
    real_time: float | None
    overwrite: bool
    signals: Sequence[str]
    output_format: str
    reference: _Path | None
    tolerance: Mapping[str, Tolerance | float | Mapping[str, Any]]
    margins: _Path | None
    checkpoint: _Path | None
    resume: _Path | None
    profile: bool

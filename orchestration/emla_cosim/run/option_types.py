"""Types of the options that Python takes as keyword arguments, made of the fields of `Options`.

Change the fields, then run `python -m tests.support.option_types`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ..base.option import FileOrObject
from ..inputs.input import Input
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.step_size_control import StepSizeControl
from ..recorders.tubes.tolerance import Tolerance
from ..system.fault import Fault
from ..system.model import Replacement, Value


class RunOptions(TypedDict, total=False):
    """Options of `Simulation.run`, `attempt` and `start`."""

    set: Mapping[str, Value | np.generic | Sequence[Value] | NDArray[Any]]
    follow_models: bool
    stop_time: float | str | None
    step_size: float | str | None
    algorithm: str | Algorithm
    start_time: float | str | None
    stop_when: Sequence[str]
    threads: int | None
    real_time: float | None
    fmi_tolerance: float | None
    integrator: str
    integrator_step: float | str | None
    step_size_control: str | StepSizeControl | None
    estimate_coupling: bool
    overwrite: bool
    signals: Sequence[str]
    output_interval: float | str | None
    output_format: str
    require: Sequence[str]
    reference: str | Path | None
    tolerance: Mapping[str, Tolerance | float | Mapping[str, Any]]
    roles: Mapping[str, str]
    criteria: Mapping[str, float | str]
    bonds: Mapping[str, str]
    margins: str | Path | None
    checkpoint: str | Path | None
    resume: str | Path | None
    profile: bool
    extrapolation: str
    step_multiples: Mapping[str, int]
    order: Sequence[str]
    coupling_tolerance: float
    error_tolerance: float | None
    largest_step: float | str | None


class PrepareOptions(RunOptions, total=False):
    """Options of `Scenario.prepare` and `export`."""

    replace: Mapping[str, Replacement | str | Path | Mapping[str, Any]]
    input: Sequence[Input | str | Path | Mapping[str, Any]]
    fault: Sequence[Fault | str | Mapping[str, Any]]
    parameters: Sequence[str | Path]
    mapping: Mapping[str, str | Path]
    kind: Mapping[str, str]
    no_event_mode: Sequence[str] | bool
    integrate_together: bool
    isolate: Sequence[str] | bool
    lenient: bool
    flavour: str
    fmus: str | Path | None
    platform: Sequence[str]
    fmi: int
    inputs: Sequence[str]
    outputs: Sequence[str]
    components: Sequence[str]
    precision: str


class LoadOptions(PrepareOptions, total=False):
    """Options of `load` and `info`."""

    controller: str | type | None
    gains: str | None
    actuator: Mapping[str, str | Path | FileOrObject]
    sheet: Mapping[str, float | int | bool | str]
    trajectory: str | Path | None


class CompareOptions(TypedDict, total=False):
    """Options of `compare`."""

    set: Mapping[str, Value | np.generic | Sequence[Value] | NDArray[Any]]
    replace: Mapping[str, Replacement | str | Path | Mapping[str, Any]]
    input: Sequence[Input | str | Path | Mapping[str, Any]]
    actuator: Mapping[str, str | Path | FileOrObject]
    sheet: Mapping[str, float | int | bool | str]
    fault: Sequence[Fault | str | Mapping[str, Any]]
    trajectory: str | Path | None
    parameters: Sequence[str | Path]
    mapping: Mapping[str, str | Path]
    follow_models: bool
    kind: Mapping[str, str]
    no_event_mode: Sequence[str] | bool
    integrate_together: bool
    isolate: Sequence[str] | bool
    lenient: bool
    flavour: str
    fmus: str | Path | None
    stop_time: float | str | None
    step_size: float | str | None
    algorithm: str | Algorithm
    start_time: float | str | None
    stop_when: Sequence[str]
    fmi_tolerance: float | None
    integrator: str
    integrator_step: float | str | None
    step_size_control: str | StepSizeControl | None
    output_interval: float | str | None
    criteria: Mapping[str, float | str]
    timeout: float | str | None
    patience: float | str
    extrapolation: str
    step_multiples: Mapping[str, int]
    order: Sequence[str]
    coupling_tolerance: float
    error_tolerance: float | None
    largest_step: float | str | None


class TuneOptions(CompareOptions, total=False):
    """Options of `tune`."""

    controller: str | type | None
    gains: str | None
    estimate_coupling: bool
    roles: Mapping[str, str]
    bonds: Mapping[str, str]


class SweepOptions(TuneOptions, total=False):
    """Options of `sweep`."""

    require: Sequence[str]

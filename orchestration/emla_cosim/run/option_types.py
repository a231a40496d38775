"""Types of the options that Python takes as keyword arguments, made of the table in `options.py`.

Change the table, then run `python -m tests.support.option_types`.
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
    start_time: float | str | None
    stop_time: float | str | None
    step_size: float | str | None
    fmi_tolerance: float | None
    integrator: str
    integrator_step: float | str | None
    algorithm: str | Algorithm
    step_size_control: str | StepSizeControl | None
    estimate_coupling: bool
    threads: int | None
    real_time: float | None
    overwrite: bool
    output_format: str
    signals: Sequence[str]
    output_interval: float | str | None
    roles: Mapping[str, str]
    criteria: Mapping[str, float | str]
    bonds: Mapping[str, str]
    stop_when: Sequence[str]
    require: Sequence[str]
    reference: str | Path | None
    tolerance: Mapping[str, Tolerance | float | Mapping[str, Any]]
    margins: str | Path | None
    profile: bool
    checkpoint: str | Path | None
    resume: str | Path | None
    extrapolation: str
    step_multiples: Mapping[str, int]
    order: Sequence[str]
    coupling_tolerance: float
    error_tolerance: float | None
    largest_step: float | str | None


class PrepareOptions(RunOptions, total=False):
    """Options of `Scenario.prepare` and `export`."""

    parameters: Sequence[str | Path]
    replace: Mapping[str, Replacement | str | Path | Mapping[str, Any]]
    mapping: Mapping[str, str | Path]
    kind: Mapping[str, str]
    no_event_mode: Sequence[str] | bool
    fault: Sequence[Fault | str | Mapping[str, Any]]
    input: Sequence[Input | str | Path | Mapping[str, Any]]
    flavour: str
    fmus: str | Path | None
    platform: Sequence[str]
    fmi: int
    inputs: Sequence[str]
    outputs: Sequence[str]
    components: Sequence[str]
    precision: str
    integrate_together: bool
    isolate: Sequence[str] | bool
    lenient: bool


class LoadOptions(PrepareOptions, total=False):
    """Options of `load` and `info`."""

    controller: str | type | None
    gains: str | None
    trajectory: str | Path | None
    actuator: Mapping[str, str | Path | FileOrObject]
    sheet: Mapping[str, float | int | bool | str]


class CompareOptions(TypedDict, total=False):
    """Options of `compare`."""

    set: Mapping[str, Value | np.generic | Sequence[Value] | NDArray[Any]]
    follow_models: bool
    parameters: Sequence[str | Path]
    replace: Mapping[str, Replacement | str | Path | Mapping[str, Any]]
    mapping: Mapping[str, str | Path]
    kind: Mapping[str, str]
    no_event_mode: Sequence[str] | bool
    fault: Sequence[Fault | str | Mapping[str, Any]]
    input: Sequence[Input | str | Path | Mapping[str, Any]]
    trajectory: str | Path | None
    actuator: Mapping[str, str | Path | FileOrObject]
    sheet: Mapping[str, float | int | bool | str]
    flavour: str
    fmus: str | Path | None
    start_time: float | str | None
    stop_time: float | str | None
    step_size: float | str | None
    fmi_tolerance: float | None
    integrator: str
    integrator_step: float | str | None
    integrate_together: bool
    algorithm: str | Algorithm
    step_size_control: str | StepSizeControl | None
    isolate: Sequence[str] | bool
    lenient: bool
    output_interval: float | str | None
    criteria: Mapping[str, float | str]
    stop_when: Sequence[str]
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

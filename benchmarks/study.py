"""The job that all tools run: the scenario `study` with native FMUs."""

from collections.abc import Mapping
from pathlib import Path

from emla_cosim.fmu.file import FmuFile, open_fmu
from emla_cosim.fmu.models import build
from emla_cosim.study.loading import load
from emla_cosim.system.model import System

from .job import Component, Input, Job, Output, StartValue

SCENARIO = "study"
STEP = 1e-4
"""Communication step in s."""
STEPS_PER_ROW = 10
"""Steps per recorded row."""


def study_job(fmus: Path, scratch: Path, values: Mapping[str, float] | None = None) -> Job:
    """Build the FMUs to `fmus`, unpack them to `scratch` and describe what to run; `steps` are still 0.

    `values` are start values beside those of the scenario; names may be patterns.
    """
    with load(SCENARIO, fmus=fmus, set=dict(values or {})).prepare() as prepared:
        system = prepared.system
    models = dict.fromkeys(c.model for c in system.components)
    files = {m: open_fmu(build(m, "native", [], fmus), scratch / m) for m in models}
    outputs = {m: _outputs(file) for m, file in files.items()}
    signals = [(c.name, output.name) for c in system.components for output in outputs[c.model]]
    components = tuple(
        Component(
            name=c.name,
            fmu=str(files[c.model].path),
            folder=str(files[c.model].folder),
            library=str(files[c.model].library),
            identifier=files[c.model].model_identifier,
            guid=str(files[c.model].description.guid),
            start_values=_start_values(files[c.model], dict(c.parameters)),
            inputs=_inputs(files[c.model], system, c.name, signals),
            outputs=outputs[c.model],
        )
        for c in system.components
    )
    return Job(components, STEP, 0, STEPS_PER_ROW, str(scratch))


def _outputs(file: FmuFile) -> tuple[Output, ...]:
    variables = [v for v in file.variables.values() if v.causality == "output" and v.type == "Real"]
    return tuple(Output(v.name, v.valueReference) for v in variables)


def _inputs(
    file: FmuFile, system: System, component: str, signals: list[tuple[str, str]]
) -> tuple[Input, ...]:
    return tuple(
        Input(x.input, file.variables[x.input].valueReference, signals.index((x.source, x.output)))
        for x in system.connections
        if x.target == component
    )


def _start_values(file: FmuFile, values: dict) -> tuple[StartValue, ...]:
    typed = {"Real": float, "Integer": int, "Boolean": bool}
    found = []
    for name, value in values.items():
        variable = file.variables[name]
        converted = typed[variable.type](value)
        found.append(StartValue(name, variable.type, variable.valueReference, converted))
    return tuple(found)

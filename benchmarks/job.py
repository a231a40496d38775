"""The job that every tool runs. This needs the standard library only, so that any environment can read it."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class StartValue:
    """A value that a variable gets before initialization; `type` is Real, Integer or Boolean."""

    name: str
    type: str
    reference: int
    value: float


@dataclass(frozen=True)
class Input:
    """A connected input, and the position of its source in the vector of all signals."""

    name: str
    reference: int
    signal: int


@dataclass(frozen=True)
class Output:
    """A Real output. The signals are the outputs of all components, one component after the other."""

    name: str
    reference: int


@dataclass(frozen=True)
class Component:
    """One FMU instance: its file, where that is unpacked, its library there, and its variables."""

    name: str
    fmu: str
    folder: str
    library: str
    identifier: str
    guid: str
    start_values: tuple[StartValue, ...]
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]


@dataclass(frozen=True)
class Job:
    """One run: `steps` communication steps of `step` s, all signals recorded at each `every`th of them.

    `scratch` is a folder for files of the run, `initial` the signals after initialization. `options` are
    those of our own master.
    """

    components: tuple[Component, ...]
    step: float
    steps: int
    every: int
    scratch: str
    initial: tuple[float, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def stop(self) -> float:
        """The stop time in s for FMUs: late enough for times that are sums of steps."""
        return (self.steps + 1) * self.step

    @property
    def signals(self) -> list[tuple[Component, Output]]:
        """Component and output of every signal, in order."""
        return [(c, output) for c in self.components for output in c.outputs]

    def with_steps(self, steps: int) -> "Job":
        """Return the same job with another number of steps."""
        return replace(self, steps=steps)

    def save(self, path: Path) -> None:
        """Write the job as JSON."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")


def load_job(path: Path) -> Job:
    """Read a file of `Job.save`."""
    content = json.loads(path.read_text(encoding="utf-8"))
    components = tuple(
        Component(
            **{
                **c,
                "start_values": tuple(StartValue(**v) for v in c["start_values"]),
                "inputs": tuple(Input(**v) for v in c["inputs"]),
                "outputs": tuple(Output(**v) for v in c["outputs"]),
            }
        )
        for c in content["components"]
    )
    return Job(**{**content, "components": components, "initial": tuple(content["initial"])})

"""Systems of faulty FMUs in a few words, and runs of them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from emla_cosim.base.units import LinearTransformation
from emla_cosim.master.assembly import Assembly
from emla_cosim.run.result import Result
from emla_cosim.study.loading import load
from emla_cosim.system.model import Component, Connection, System
from tests.support.hand_written_fmus import Counts, Fault
from tests.support.scenario_runs import run_scenario


def faulty(name: str, fmu: Path, **parameters: float) -> Component:
    """An instance of the faulty FMU with these start values."""
    return Component(name, "Faulty", parameters, fmu)


def wired(components: list[Component], *wires: str) -> System:
    """A system with these connections, written as `j.a.y -> j.b.u`."""
    ends = [[end.rpartition(".") for end in wire.split(" -> ")] for wire in wires]
    return System(
        tuple(components),
        tuple(
            Connection(source, output, target, input_) for (source, _, output), (target, _, input_) in ends
        ),
    )


def line_with_a_fault(fmu: Path, fault: Fault, at: float, **parameters: float) -> System:
    """A source of 2, the faulty one that integrates it, and one that integrates that again."""
    return wired(
        [
            faulty("j.source", fmu, a=0.0, b=1.0, u=2.0),
            faulty("j.bad", fmu, b=0.5, fault=fault, at=at, **parameters),
            faulty("j.sink", fmu),
        ],
        "j.source.y -> j.bad.u",
        "j.bad.y -> j.sink.u",
    )


def loop_with_a_fault(fmu: Path, fault: Fault, at: float, **parameters: float) -> System:
    """A loop of the faulty one and two others, all at rest."""
    return wired(
        [
            faulty("j.bad", fmu, fault=fault, at=at, **parameters),
            faulty("j.force", fmu, a=-1.0, b=-0.5),
            faulty("j.speed", fmu, b=0.25),
        ],
        "j.speed.y -> j.bad.u",
        "j.bad.y -> j.force.u",
        "j.force.y -> j.speed.u",
    )


@contextmanager
def open_system(system: System, transformations: Sequence[tuple[float, float]] = ()) -> Iterator[Assembly]:
    """The instances of a system whose components all name their FMU.

    `transformations` gives factor and offset of every connection, unless all are 1 and 0.
    """
    if transformations:
        transformed = (
            replace(x, transformation=LinearTransformation(*t))
            for x, t in zip(system.connections, transformations, strict=True)
        )
        system = replace(system, connections=tuple(transformed))
    with Assembly(system, {c.name: c.fmu for c in system.components if c.fmu}) as assembly:
        yield assembly


def run_system(
    system: System,
    folder: Path,
    algorithm: str = "jacobi",
    stop_time: float = 1.0,
    step_size: float = 0.1,
    **options: Any,
) -> Result:
    """Run a system quietly, with its results in the folder."""
    scenario = load(system, algorithm=algorithm, stop_time=stop_time, step_size=step_size)
    return run_scenario(scenario, folder, **options)


def counts_of(assembly: Assembly) -> list[Counts]:
    """Counters of every faulty FMU in a system."""
    return [
        Counts(folder, name)
        for folder, name in {(file.folder, file.model_identifier) for file in assembly.files.values()}
    ]

"""Runs of an FMU that go on from a saved state, in this process or in another one."""

import multiprocessing
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave

from tests.support.sessions import status


@dataclass(frozen=True)
class Step:
    """Sets all inputs, or leaves them; native FMUs can let them move as well."""

    size: float
    inputs: tuple[float, ...] | None = None
    slopes: tuple[float, ...] = ()


class Run:
    """Steps of one instance and, after each, its status and the bits of every Real variable."""

    def __init__(self, slave: FMU2Slave, folder: str, time: float = 0.0) -> None:
        variables = read_model_description(folder).modelVariables
        self.slave, self.time = slave, time
        self.inputs = [v.valueReference for v in variables if v.causality == "input"]
        self.everything = [v.valueReference for v in variables if v.type == "Real"]

    def values(self) -> bytes:
        found = self.slave.getReal(self.everything)
        return struct.pack(f"{len(found)}d", *found)

    def set(self, step: Step) -> None:
        if step.inputs is not None:
            self.slave.setReal(self.inputs, step.inputs)
        if step.slopes:
            self.slave.setRealInputDerivatives(self.inputs, [1] * len(self.inputs), step.slopes)

    def go_on(self, steps: Sequence[Step]) -> list[tuple[int, bytes]]:
        found = []
        for step in steps:
            self.set(step)
            result = status(self.slave.doStep, self.time, step.size, False)
            if result == 0:
                self.time += step.size
            found.append((result, self.values()))
        return found


@dataclass(frozen=True)
class Job:
    """A run to continue: the unpacked FMU, the instance's state and time there, and what comes."""

    folder: str
    state: bytes
    time: float
    steps: tuple[Step, ...]

    def done(self) -> list[tuple[int, bytes]]:
        description = read_model_description(self.folder)
        slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="elsewhere",
        )
        slave.instantiate()
        try:
            state = slave.deSerializeFMUstate(self.state)
            slave.setFMUstate(state)
            slave.freeFMUstate(state)
            return Run(slave, self.folder, self.time).go_on(self.steps)
        finally:
            slave.freeInstance()


class Elsewhere:
    """Another process, which continues runs."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_answer, args=(other,), daemon=True)
        self._process.start()
        other.close()

    def do(self, job: Job) -> Any:
        self._pipe.send(job)
        found = self._pipe.recv()
        if isinstance(found, Exception):
            raise found
        return found

    def close(self) -> None:
        self._pipe.send(None)
        self._process.join(10.0)
        self._process.kill()


def _answer(pipe: Connection) -> None:
    while (job := pipe.recv()) is not None:
        try:
            pipe.send(job.done())
        except Exception as error:
            pipe.send(RuntimeError(f"{type(error).__name__}: {error}"))

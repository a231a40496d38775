"""Instances of one FMU for tests: opened together, freed together, and everything they log."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import pytest
from fmpy import fmi2
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave

OK, WARNING, DISCARD, ERROR, FATAL = range(5)


class Line(NamedTuple):
    instance: str
    status: int
    category: str
    text: str


class Log:
    """All messages as the FMU gives them: nothing is formatted."""

    def __init__(self) -> None:
        self.all: list[Line] = []
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)

    def lines(self, instance: str) -> list[str]:
        """Warnings and worse of one instance."""
        return [line.text for line in self.all if line.instance == instance and line.status >= WARNING]

    def _log(self, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        name, kind, text = ((x or b"").decode() for x in (instance, category, message))
        self.all.append(Line(name, status, kind, text))


class Session:
    """FMU instances of one file, freed together, and what they logged."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(path))
        self.folder = folder
        fmpy.extract(str(path), folder)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.log = Log()
        self.slaves: list[Any] = []

    def references(self, names: Sequence[str]) -> list[int]:
        return [self.variables[n].valueReference for n in names]

    def names(self, *causalities: str, fmi_type: str = "Real") -> list[str]:
        variables = self.description.modelVariables
        return [v.name for v in variables if v.causality in causalities and v.type == fmi_type]

    @property
    def states(self) -> list[str]:
        """Names of the continuous states."""
        return [d.variable.derivative.name for d in self.description.derivatives]

    def new(self, name: str = "toy", kind: Any = FMU2Slave, logging: bool = True) -> Any:
        """An instance as fmi2Instantiate gives it."""
        interface = self.description.coSimulation or self.description.modelExchange
        slave = kind(
            guid=self.description.guid,
            unzipDirectory=str(self.folder),
            modelIdentifier=interface.modelIdentifier,
            instanceName=name,
        )
        slave.instantiate(callbacks=self.log.callbacks, loggingOn=logging)
        self.slaves.append(slave)
        return slave

    def instance(
        self, name: str = "toy", running: bool = True, of: Any = FMU2Slave, time: float = 0.0, **values: Any
    ) -> Any:
        """An instance in initialization, or after it; Model Exchange is then in continuous time."""
        slave = self.new(name, of)
        self.initialize(slave, running, time, **values)
        return slave

    def initialize(self, slave: Any, running: bool = True, time: float = 0.0, **values: Any) -> None:
        slave.setupExperiment(startTime=time)
        self.set(slave, **values)
        slave.enterInitializationMode()
        if running:
            slave.exitInitializationMode()
            if isinstance(slave, FMU2Model):
                slave.newDiscreteStates()
                slave.enterContinuousTimeMode()

    def set(self, slave: Any, **values: Any) -> None:
        setters = {"Real": slave.setReal, "Boolean": slave.setBoolean}
        for name, value in values.items():
            setter = setters.get(self.variables[name].type, slave.setInteger)
            setter(self.references([name]), [value])

    def get(self, slave: Any, *names: str) -> list[float]:
        return slave.getReal(self.references(names))

    def close(self) -> None:
        for slave in self.slaves:
            slave.freeInstance()


@contextmanager
def opened(path: Path, folder: Path) -> Iterator[Session]:
    session = Session(path, folder)
    try:
        yield session
    finally:
        session.close()


@contextmanager
def refused(*statuses: int) -> Iterator[None]:
    """The call fails with one of these statuses, fmi2Error unless given."""
    with pytest.raises(FMICallException) as failure:
        yield
    assert failure.value.status in (statuses or (ERROR,))


def status(call: Callable[..., Any], *arguments: Any) -> int:
    """The status of a call, whether fmpy returns or raises it."""
    try:
        return call(*arguments) or OK
    except FMICallException as failure:
        return failure.status


def continuous_states(model: FMU2Model, n: int) -> list[float]:
    x = (fmi2.fmi2Real * n)()
    model.getContinuousStates(x, n)
    return list(x)


def set_continuous_states(model: FMU2Model, x: Sequence[float]) -> None:
    model.setContinuousStates((fmi2.fmi2Real * len(x))(*x), len(x))


def derivatives(model: FMU2Model, n: int) -> list[float]:
    x_dot = (fmi2.fmi2Real * n)()
    model.getDerivatives(x_dot, n)
    return list(x_dot)

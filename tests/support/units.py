"""One instance of a block behind one interface: in process, or as an FMU of any flavour and FMI version.

Calls of a unit return whether they succeeded, and what is logged is in its `messages`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from fmpy.fmi1 import FMICallException

from fmublock import Block, BlockError, Instance, build
from tests.support.fmi3_host import Host
from tests.support.sessions import WARNING, Session

KINDS = ("block", "native", "python", "fmi3")


class BlockUnit:
    """A block in process."""

    def __init__(self, block: type[Block], name: str) -> None:
        self.instance, self.messages = Instance(block(), name), list[str]()

    def _call(self, call: Callable[..., Any], *arguments: Any) -> bool:
        try:
            call(*arguments)
        except BlockError as error:
            self.messages.append(str(error))
            return False
        return True

    def enter(self, time: float = 0.0, stop: float | None = None) -> bool:
        return self._call(self.instance.setup_experiment, time, stop) and self._call(
            self.instance.enter_initialization
        )

    def exit(self) -> bool:
        succeeded = self._call(self.instance.exit_initialization)
        self.messages += self.instance.left_limits() if succeeded else []
        return succeeded

    def set(self, **values: Any) -> bool:
        return all(self._call(self.instance.__setitem__, n, float(v)) for n, v in values.items())

    def get(self, *names: str) -> list[float]:
        return [self.instance[name] for name in names]

    def step(self, time: float, step: float) -> bool:
        succeeded = self._call(self.instance.do_step, time, step)
        self.messages += self.instance.left_limits() if succeeded else []
        return succeeded

    def save(self) -> Any:
        return self.instance.get_state()

    def restore(self, state: Any) -> None:
        self.instance.set_state(state)


class FmuUnit:
    """What instances of both FMI versions have in common."""

    slave: Any

    def exit(self) -> bool:
        return _is_done(self.slave.exitInitializationMode)

    def step(self, time: float, step: float) -> bool:
        return _is_done(self.slave.doStep, time, step)


class Fmi2Unit(FmuUnit):
    """An instance of an FMU for FMI 2.0."""

    def __init__(self, session: Session, name: str) -> None:
        self.session, self.name, self._before = session, name, len(session.log.all)
        self.slave = session.new(name)

    @property
    def messages(self) -> list[str]:
        lines = self.session.log.all[self._before :]
        return [line.text for line in lines if line.instance == self.name and line.status >= WARNING]

    def enter(self, time: float = 0.0, stop: float | None = None) -> bool:
        return _is_done(self.slave.setupExperiment, None, time, stop) and _is_done(
            self.slave.enterInitializationMode
        )

    def set(self, **values: Any) -> bool:
        return _is_done(lambda: self.session.set(self.slave, **values))

    def get(self, *names: str) -> list[float]:
        return self.session.get(self.slave, *names)

    def save(self) -> bytes:
        saved = self.slave.getFMUstate()
        state = self.slave.serializeFMUstate(saved)
        self.slave.freeFMUstate(saved)
        return state

    def restore(self, state: bytes) -> None:
        copy = self.slave.deSerializeFMUstate(state)
        self.slave.setFMUstate(copy)
        self.slave.freeFMUstate(copy)


class Fmi3Unit(FmuUnit):
    """An instance of an FMU for FMI 3.0, where an array is one variable."""

    def __init__(self, host: Host, name: str) -> None:
        self.host, self._before = host, len(host.lines)
        self.slave = host.new(name=name)
        self._variables = {v.name: v for v in host.description.modelVariables}
        self._start: dict[str, list[float]] = {}  # arrays are set as a whole

    @property
    def messages(self) -> list[str]:
        return [text for status, text in self.host.lines[self._before :] if status >= WARNING]

    def enter(self, time: float = 0.0, stop: float | None = None) -> bool:
        return _is_done(self.slave.enterInitializationMode, None, time, stop)

    def set(self, **values: Any) -> bool:
        return all(_is_done(self._set, name, value) for name, value in values.items())

    def _set(self, name: str, value: Any) -> None:
        variable, index = self._find(name)
        if variable.dimensions:
            elements = self._start.setdefault(variable.name, [float(x) for x in variable.start.split()])
            elements[index] = value
            self.slave.setFloat64([variable.valueReference], elements)
            return
        setters = {"Float64": self.slave.setFloat64, "Boolean": self.slave.setBoolean}
        setters |= {"Int32": self.slave.setInt32}
        setters.get(variable.type, self.slave.setInt64)([variable.valueReference], [value])

    def get(self, *names: str) -> list[float]:
        values = []
        for variable, index in map(self._find, names):
            size = int(variable.dimensions[0].start) if variable.dimensions else 1
            values.append(self.slave.getFloat64([variable.valueReference], nValues=size)[index])
        return values

    def _find(self, name: str) -> tuple[Any, int]:
        """Return the variable and the position in it."""
        array, _, number = name.removesuffix("]").partition("[")
        return self._variables[array], int(number or 1) - 1

    def save(self) -> bytes:
        saved = self.slave.getFMUState()
        state = self.slave.serializeFMUState(saved)
        self.slave.freeFMUState(saved)
        return state

    def restore(self, state: bytes) -> None:
        copy = self.slave.deserializeFMUState(state)
        self.slave.setFMUState(copy)
        self.slave.freeFMUState(copy)


Unit = BlockUnit | Fmi2Unit | Fmi3Unit
Make = Callable[..., Unit]


class Units:
    """Makes units of blocks; each FMU is built and opened once."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._opened = folder, dict[tuple[type[Block], str], Session | Host]()

    def make(self, block: type[Block], kind: str, name: str = "toy") -> Unit:
        if kind == "block":
            return BlockUnit(block, name)
        opened = self.opened(block, kind)
        return Fmi3Unit(opened, name) if isinstance(opened, Host) else Fmi2Unit(opened, name)

    def opened(self, block: type[Block], kind: str) -> Session | Host:
        key = block, kind
        if key not in self._opened:
            folder = self._folder / f"{block.__name__} {kind}"
            flavour, fmi = ("python", 2) if kind == "python" else ("native", 3 if kind == "fmi3" else 2)
            fmu = build(block, folder / f"{block.__name__}.fmu", flavour=flavour, fmi=fmi)
            self._opened[key] = (Host if fmi == 3 else Session)(fmu, folder / "unpacked")
        return self._opened[key]

    def close(self) -> None:
        for opened in self._opened.values():
            opened.close()


def start(unit: Unit, time: float = 0.0, stop: float | None = None, **values: Any) -> Unit:
    """Set start values, and initialize."""
    assert unit.set(**values)
    assert unit.enter(time, stop)
    assert unit.exit(), unit.messages
    return unit


def _is_done(call: Callable[..., Any], *arguments: Any) -> bool:
    try:
        call(*arguments)
    except FMICallException:
        return False
    return True

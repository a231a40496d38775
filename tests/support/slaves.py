"""Slaves for tests: FMUs opened alone, blocks in process, and fakes of a few lines."""

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from emla_cosim.fmu.file import open_fmu
from emla_cosim.fmu.log import FmuLog
from emla_cosim.fmu.variables import convert_start_values
from emla_cosim.master.instances.fmu_instance import (
    DiscardedStepError,
    EntryPoints,
    FmuInstance,
    InstanceError,
)
from emla_cosim.master.instances.in_process_instance import InProcessInstance
from fmublock import Block
from fmublock.instance import Instance
from fmublock.variables import Output, State


def interface(block: type[Block]) -> tuple[list[str], list[str]]:
    """Names of a block's inputs and of its outputs, in order."""
    layout = block.layout()
    outputs = [s.name for s in layout.scalars if isinstance(s.variable, (State, Output))]
    return [s.name for s in layout.scalars if s.variable in layout.inputs], outputs


@contextmanager
def fmu_slave(
    path: Path, inputs: Sequence[str], outputs: Sequence[str], parameters: Mapping[str, Any] | None = None
) -> Iterator[InProcessInstance]:
    """One instance of an FMU, with start values set, freed afterwards."""
    with TemporaryDirectory() as folder:
        file = open_fmu(path, Path(folder))
        slave = InProcessInstance("test", file, inputs, outputs, FmuLog())
        try:
            slave.set_start_values(convert_start_values("test", file.interface, parameters or {}))
            yield slave
        finally:
            slave.close()


class BlockSlave(FmuInstance):
    """A block in process behind the slave protocol."""

    def __init__(self, block: Block, parameters: Mapping[str, Any] | None = None, name: str = "test") -> None:
        self.name = name
        self.instance = Instance(block, name)
        layout = self.instance.layout
        inputs, outputs = interface(type(block))
        self._inputs = [layout.reference(n) for n in inputs]
        self._outputs = [layout.reference(n) for n in outputs]
        self.inputs = np.array(self.instance.get(self._inputs))
        self.outputs = np.zeros(len(outputs))
        self.continuous_inputs = np.ones(len(inputs), dtype=bool)
        self.continuous_outputs = np.ones(len(outputs), dtype=bool)
        self.nominals = np.ones(len(outputs))
        for variable, value in (parameters or {}).items():
            self.instance.set([layout.reference(variable)], [value])

    def enter_initialization(self, start_time: float, stop_time: float) -> None:
        self.instance.setup_experiment(start_time)
        self.instance.enter_initialization()

    def exit_initialization(self) -> None:
        self.instance.exit_initialization()

    def set_inputs(self) -> None:
        self.instance.set(self._inputs, [float(x) for x in self.inputs])

    def get_outputs(self) -> None:
        self.outputs[:] = self.instance.get(self._outputs)

    def do_step(self, time: float, step: float) -> None:
        self.instance.do_step(time, step)

    def close(self) -> None:
        pass


class FakeSlave(FmuInstance):
    """A slave whose step is a Python function (inputs, state, time, step) -> new state.

    Outputs are the state, or `output(inputs, state)`; every call is noted in `calls`.
    """

    rolls_back = True
    states = 0
    """Number of states that were saved and not freed."""

    def __init__(
        self,
        name: str,
        inputs: int,
        state: Sequence[float],
        advance: Callable[[np.ndarray, np.ndarray, float, float], Sequence[float]],
        output: Callable[[np.ndarray, np.ndarray], Sequence[float]] | None = None,
        calls: list[str] | None = None,
    ) -> None:
        self.name = name
        self.inputs = np.zeros(inputs)
        self.state = np.array(state, dtype=float)
        self._advance = advance
        self._output = output or (lambda u, x: x)
        self.held = np.zeros(inputs)
        self.outputs = np.zeros(len(self._output(self.held, self.state)))
        self.continuous_inputs = np.ones(inputs, dtype=bool)
        self.continuous_outputs = np.ones(len(self.outputs), dtype=bool)
        self.nominals = np.ones(len(self.outputs))
        self.calls = calls if calls is not None else []

    def enter_initialization(self, start_time: float, stop_time: float) -> None:
        self.calls.append(f"{self.name}.enter")

    def exit_initialization(self) -> None:
        self.calls.append(f"{self.name}.exit")

    def set_inputs(self) -> None:
        self.calls.append(f"{self.name}.set")
        self.held[:] = self.inputs

    def get_outputs(self) -> None:
        self.calls.append(f"{self.name}.get")
        self.outputs[:] = self._output(self.held, self.state)

    def do_step(self, time: float, step: float) -> None:
        self.calls.append(f"{self.name}.step")
        self.state[:] = self._advance(self.held, self.state, time, step)

    def save(self, state: Any = None) -> Any:
        self.calls.append(f"{self.name}.save")
        self.states += state is None
        return self.held.copy(), self.state.copy()

    def restore(self, state: Any) -> None:
        self.calls.append(f"{self.name}.restore")
        self.held[:], self.state[:] = state

    def forget(self, state: Any) -> None:
        self.states -= 1

    def close(self) -> None:
        self.calls.append(f"{self.name}.close")


Fake = TypeVar("Fake", bound=FakeSlave)
_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_SET_OR_GET = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _POINTER, _SIZE, _POINTER)
_DERIVE = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _POINTER, _SIZE, _POINTER, ctypes.POINTER(ctypes.c_double))
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, ctypes.c_double, ctypes.c_double, ctypes.c_int)
_SAVE = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, ctypes.POINTER(_SIZE))
_RESTORE = ctypes.CFUNCTYPE(ctypes.c_int, _POINTER, _SIZE)
_DISCARD, _ERROR = 2, 3


def compilable(slave: Fake) -> Fake:
    """The same slave, which compiled code can call as well: its methods as functions of C.

    Several threads can call them.
    """
    states: dict[int, Any] = {}

    def status(method: Callable[..., Any], *arguments: Any) -> int:
        try:
            method(*arguments)
        except InstanceError as error:
            return _DISCARD if isinstance(error, DiscardedStepError) else _ERROR
        return 0

    def save(component: int, pointer: Any) -> int:
        pointer[0] = pointer[0] or len(states) + 1
        states[pointer[0]] = slave.save()
        return 0

    def forget(state: Any) -> None:
        if isinstance(state, ctypes.c_void_p):
            del states[state.value or 0]

    slave.forget = forget  # type: ignore[method-assign]
    functions = [
        _SET_OR_GET(lambda component, references, count, values: status(slave.set_inputs)),
        _SET_OR_GET(lambda component, references, count, values: status(slave.get_outputs)),
        _STEP(lambda component, time, step, no_way_back: status(slave.do_step, time, step)),
        _DERIVE(
            lambda component, references, count, orders, values: status(
                slave.set_input_derivatives, np.array(values[:count])
            )
        ),
        _SAVE(save),
        _RESTORE(lambda component, number: status(slave.restore, states[number])),
    ]
    addresses = [ctypes.cast(function, _POINTER).value or 0 for function in functions]
    inputs, outputs = (np.arange(len(x), dtype=np.uint32) for x in (slave.inputs, slave.outputs))
    points = EntryPoints(0, *addresses, inputs, outputs, np.ones(len(inputs), dtype=np.int32))

    def entry_points(functions: list[Any] = functions) -> EntryPoints:  # which keeps them alive
        return points

    slave.entry_points = entry_points
    return slave

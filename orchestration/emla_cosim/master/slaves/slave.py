"""What an algorithm sees of a component, whatever is behind it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import RunError

Vector = NDArray[np.float64]


class SlaveError(RunError):
    """A call that the slave refused or failed: which one, and what the slave said."""

    def __init__(self, slave: str, call: str, status: str, log: list[str]) -> None:
        super().__init__(slave, call, status, log)
        self.slave = slave
        self.call = call
        self.status = status
        self.log = log

    def __str__(self) -> str:
        said = f" It said: {' '.join(self.log)}" if self.log else ""
        return f"{self.slave} answered {self.call} with {self.status}.{said}"


class Slave(Protocol):
    """A co-simulation slave that exchanges two preallocated vectors.

    `inputs` holds the values of its connected inputs until `set_inputs` passes them on;
    `get_outputs` writes to `outputs`, a part of the network's signals. Every method may raise
    SlaveError.
    """

    name: str
    inputs: Vector
    outputs: Vector

    def enter_initialization(self, start_time: float, stop_time: float) -> None:
        """Enter initialization mode; times in s."""
        ...

    def exit_initialization(self) -> None:
        """Leave initialization mode: the slave is ready to step."""
        ...

    def set_inputs(self) -> None:
        """Pass `inputs` on to the slave."""
        ...

    def get_outputs(self) -> None:
        """Read the slave's outputs into `outputs`."""
        ...

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        ...

    def close(self) -> None:
        """Free the slave; never raises."""
        ...

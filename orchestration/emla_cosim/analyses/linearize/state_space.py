"""State matrices of a continuous system: x' = A x + B u, y = C x + D u."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from .response import Complex, import_control


@dataclass(frozen=True)
class StateSpace:
    """State matrices of a system at an operating point.

    All values are differences from the operating point, in the units of the variables.

    Attributes:
        states: Full names of the states.
        inputs: Full names of the inputs.
        outputs: Full names of the outputs.
        units: Units by name.
        A: Derivatives by states, shape (states, states).
        B: Derivatives by inputs, shape (states, inputs).
        C: Outputs by states, shape (outputs, states).
        D: Outputs by inputs, shape (outputs, inputs).
        at_states: States at the operating point.
        at_inputs: Inputs at the operating point.
        at_outputs: Outputs at the operating point.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    at_states: Vector
    at_inputs: Vector
    at_outputs: Vector

    @property
    def poles(self) -> Complex:
        """Poles in 1/s, slow ones first."""
        poles = np.linalg.eigvals(self.A).astype(np.complex128)
        return poles[np.lexsort((poles.imag, np.abs(poles).round(12)))]

    @property
    def damping(self) -> Vector:
        """Damping ratio of each pole: 1 without oscillation, 0 or less if it does not decay."""
        size = np.abs(self.poles)
        return np.where(size > 0.0, -self.poles.real / np.maximum(size, 1e-300), 0.0)

    @property
    def record(self) -> dict[str, Any]:
        """Content for `linearize.json`."""
        return {
            **{
                kind: [
                    {"name": n, "unit": self.units[n], "value": float(x)}
                    for n, x in zip(getattr(self, kind), getattr(self, f"at_{kind}"), strict=True)
                ]
                for kind in ("states", "inputs", "outputs")
            },
            **{name: getattr(self, name).tolist() for name in "ABCD"},
            "poles": [
                {"real": float(p.real), "imag": float(p.imag), "damping": float(d)}
                for p, d in zip(self.poles, self.damping, strict=True)
            ],
        }

    def to_control(self) -> Any:
        """Return the matrices as `control.StateSpace`, with the names of states, inputs and outputs.

        Raises:
            CommandError: python-control is not installed.
        """
        names = {
            kind: [n.replace(".", "_") for n in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        return import_control().ss(self.A, self.B, self.C, self.D, **names)

    def to_scipy(self) -> Any:
        """Return the matrices as `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace as ScipyStateSpace  # slow to import

        return ScipyStateSpace(self.A, self.B, self.C, self.D)

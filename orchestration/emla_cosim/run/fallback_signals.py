"""Choose the signals of a run whose FMUs have no outputs of numbers."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

from ..fmu.elements import BINARY
from ..system.names import NamedVariable

MOST = 50
"""Most signals that are recorded without being asked for."""


@dataclass(frozen=True)
class FallbackSignals:
    """Signals to record instead of outputs, and the remark on them."""

    names: list[str]
    remark: str


def choose_fallback_signals(others: Iterable[NamedVariable]) -> FallbackSignals:
    """Return the continuous states, else the local variables, at most `MOST`.

    Args:
        others: Variables that the option `signals` can name.
    """
    variables = [v for v in others if v.variable.type not in ("String", BINARY)]
    rates = [(v.component.name, v.variable.derivative) for v in variables]
    states = {(component, state.name) for component, state in rates if state is not None}
    of_kind = {
        "continuous states": [v.full_name for v in variables if v.end in states],
        "local variables": [v.full_name for v in variables if str(v.variable.causality) == "local"],
    }
    said = "No FMU has an output of a number"
    for kind, names in of_kind.items():
        if names:
            few = f"the first {MOST} of the {len(names)} {kind}" if len(names) > MOST else f"the {kind}"
            return FallbackSignals(
                list(islice(names, MOST)), f"{said}; {few} are recorded instead. Set --signals to choose."
            )
    return FallbackSignals(
        [], f"{said}, a state or a local variable; only `time` is recorded. Set --signals to record others."
    )

"""One joint: reference, plant, disturbance, observer and controller, connected."""

from collections.abc import Mapping, Sequence
from typing import Any

from emla_fmu import Disturbance, EmlaObserver, EmlaPlant, Reference
from fmublock import Block
from fmublock.variables import Variable
from rsba_fmu import RsbaController

from .model import Component, Connection, System, Value

_WIRES = (
    "reference.x_d -> controller.x_d",
    "reference.v_d -> controller.v_d",
    "reference.a_d -> controller.a_d",
    "disturbance.F_L -> plant.F_L",
    "disturbance.d_2 -> plant.d_2",
    "disturbance.d_3 -> plant.d_3",
    "disturbance.d_4 -> plant.d_4",
    "plant.v_L -> disturbance.v_L",  # (98) contains arctan(x_2)
    "plant.x_measured -> observer.y",
    "plant.i_q -> controller.i_q",
    "plant.i_d -> controller.i_d",
    "controller.u_q -> plant.u_q",
    "controller.u_d -> plant.u_d",
    "controller.i_q_ref -> plant.i_q_ref",
    "controller.i_q_ref -> observer.i_q_ref",
)
_ESTIMATED = ("observer.x_hat -> controller.x_hat", "observer.v_hat -> controller.v_hat")
_TRUE = ("plant.x_L -> controller.x_hat", "plant.v_L -> controller.v_hat")


def joint(
    name: str,
    *,
    emla: Any,
    gains: Any,
    observer_gains: Any,
    reference: Mapping[str, Any],
    disturbance: Mapping[str, Any],
    plant: Mapping[str, Any],
    estimate: float,
    true_feedback: bool = False,
) -> System:
    """A joint from its parameter sets.

    `emla`, `gains` and `observer_gains` are parameter sets; `reference`, `disturbance` and
    `plant` are values by attribute of the block. `estimate` is the observer's start in m. With
    `true_feedback` the controller gets the plant's true states and the observer only watches.
    """
    blocks: dict[type[Block], tuple[str, Sequence[Any]]] = {
        Reference: ("reference", [reference]),
        EmlaPlant: ("plant", [emla, plant]),
        Disturbance: ("disturbance", [disturbance]),
        EmlaObserver: ("observer", [emla, observer_gains, {"x_hat_start": estimate}]),
        RsbaController: ("controller", [emla, gains]),
    }
    components = [
        Component(f"{name}.{role}", block.__name__, start_values(block, *sources))
        for block, (role, sources) in blocks.items()
    ]
    wires = (*_WIRES, *(_TRUE if true_feedback else _ESTIMATED))
    return System(tuple(components), tuple(_connection(name, wire) for wire in wires))


def start_values(block: type[Block], *sources: Any) -> dict[str, Value]:
    """Start values by FMI name: of each source, what has the name of an attribute of the block.

    Sources are mappings, or objects with attributes; later ones win. Raises KeyError for a
    key of a mapping that the block does not have.
    """
    layout = block.layout()
    settable = {x.attribute: x for x in (*layout.inputs, *layout.parameters, *layout.states)}
    values: dict[str, Value] = {}
    for source in sources:
        if isinstance(source, Mapping):
            if unknown := set(source) - set(settable):
                raise KeyError(f"{block.__name__} has no variable {', '.join(sorted(unknown))}")
            given = dict(source)
        else:
            given = {a: getattr(source, a) for a in settable if hasattr(source, a)}
        for attribute, value in given.items():
            values |= _by_fmi_name(settable[attribute], value)
    return values


def _by_fmi_name(variable: Variable, value: Any) -> dict[str, Value]:
    names = [s.name for s in variable.scalars()]
    return dict(zip(names, variable.flat(value), strict=True))


def _connection(joint: str, wire: str) -> Connection:
    source, target = wire.split(" -> ")
    (source, output), (target, input_) = source.split(".", 1), target.split(".", 1)
    return Connection(f"{joint}.{source}", output, f"{joint}.{target}", input_)

"""The controllers that a joint can have, and the sets of gains that they come with."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from emla_fmu import observer_gains
from fmublock import Block
from rsba_fmu import (
    AnatcController,
    CacController,
    FocController,
    RsbaController,
    anatc_gains,
    cac_gains,
    foc_gains,
    gains,
)

from ..base.errors import CommandError, check_choice, listed
from ..fmu.models import block_of


@dataclass(frozen=True)
class Gains:
    """Gains of controller and observer by joint; `printed_estimate` starts the observer as in (103).

    `on_machine` are those of controllers of joints that move a whole machine, where they differ.
    """

    observer: Mapping[str, Any]
    controller: Mapping[str, Any] = field(default_factory=dict)
    printed_estimate: bool = False
    on_machine: Mapping[str, Any] = field(default_factory=dict)

    def of_controller(self, joint: str, on_machine: bool) -> Any:
        """Gains of the controller of a joint; of one that brings none, nothing."""
        usual = self.controller.get(joint, {})
        return self.on_machine.get(joint, usual) if on_machine else usual


@dataclass(frozen=True)
class Controller:
    """What closes a joint's loop, a block or the file of an FMU, and its gains by the name of the set.

    The first set is the recommended one: every command takes it unless gains are named, and comparisons
    use it. A controller that brings no gains of its own runs with its start values, and with one of our
    observers.
    """

    model: type[Block] | Path
    gains: Mapping[str, Gains] = field(
        default_factory=lambda: {
            "robust": Gains(observer_gains.ROBUST),
            "compensated": Gains(observer_gains.COMPENSATED),
            "published": Gains(observer_gains.PUBLISHED, printed_estimate=True),
        }
    )

    @property
    def recommended(self) -> str:
        """Return the name of the recommended set of gains."""
        return next(iter(self.gains))


_OBSERVER = {**observer_gains.ROBUST, "prototype": observer_gains.robust(800.0)}
"""Observer of the compared controllers by rule and as published; the prototype's loop runs at 1 kHz."""


def _tuned(lift: float, tilt: float, telescope: float, prototype: float = 300.0) -> Mapping[str, Any]:
    """The compensated observer with poles at these rates in rad/s, as `emla tune` finds them."""
    poles = {"lift": lift, "tilt": tilt, "telescope": telescope, "prototype": prototype}
    return {joint: observer_gains.compensated(p) for joint, p in poles.items()}


CONTROLLERS: dict[str, Controller] = {
    "rsba": Controller(
        RsbaController,
        {
            "compensated": Gains(
                observer_gains.COMPENSATED, gains.COMPENSATED, on_machine=gains.COMPENSATED_ON_MACHINE
            ),
            "robust": Gains(observer_gains.ROBUST, gains.ROBUST),
            "published": Gains(observer_gains.PUBLISHED, gains.PUBLISHED, printed_estimate=True),
        },
    ),
    "foc": Controller(
        FocController,
        {
            "tuned": Gains(_tuned(1959.0, 2000.0, 2603.0), foc_gains.TUNED),
            "rule": Gains(_OBSERVER, foc_gains.RULE),
        },
    ),
    "cac": Controller(
        CacController,
        {
            "tuned": Gains(_tuned(1036.0, 667.0, 2890.0), cac_gains.TUNED),
            "published": Gains(_OBSERVER, cac_gains.PUBLISHED),
        },
    ),
    "anatc": Controller(
        AnatcController,
        {
            "tuned": Gains(_tuned(1403.0, 1441.0, 900.0), anatc_gains.TUNED),
            "published": Gains(_OBSERVER, anatc_gains.PUBLISHED),
        },
    ),
}
"""Controllers by name; one that you add here can be chosen wherever a name is given.

The recommended sets are like against like: the search of `emla tune` found each of them, or begins there.
"""

ROBUSTNESS_SETS = ("robust", "rule")
"""Sets that tables of robustness have beside the recommended ones, which were tuned for small errors."""


def chosen(controller: str | type | None, gain_set: str | None) -> tuple[Controller, Gains]:
    """A controller, by its name, as a block or as FILE.fmu or FILE.py:BLOCK, and a set of its gains.

    Raises CommandError for a controller or a set of gains that does not exist.
    """
    found = _controller("rsba" if controller is None else controller)
    if gain_set is not None:
        check_choice("set of gains", gain_set, found.gains)
    return found, found.gains[gain_set or found.recommended]


def _controller(name: str | type) -> Controller:
    if isinstance(name, type):
        if not issubclass(name, Block):
            raise CommandError(f"the controller {name.__name__} is no block of fmublock.")
        return Controller(name)
    if name.lower().endswith(".fmu"):
        return Controller(Path(name))
    if ".py:" in name:
        return Controller(block_of(name))
    sets = dict.fromkeys(s for controller in CONTROLLERS.values() for s in controller.gains)
    if name in sets and name not in CONTROLLERS:
        raise CommandError(
            f"'{name}' is a set of gains, not a controller; write gains = \"{name}\", or --gains {name}.",
            name=name,
        )
    if name not in CONTROLLERS:
        raise CommandError(
            f"there is no controller '{name}'; choose from {listed(CONTROLLERS)}, or name FILE.fmu or "
            "FILE.py:BLOCK.",
            name=name,
        )
    return CONTROLLERS[name]

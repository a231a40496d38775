"""The controllers of a joint, and their sets of gains."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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

from ..base.errors import CommandError, check_choice, join_names
from ..fmu.models import find_block

COMPLIANT = "compliant"
"""The default set of gains for loads that are not rigid."""


@dataclass(frozen=True)
class Gains:
    """Set of gains of the controller and the observer of a joint.

    Args:
        observer: gains of the observer by joint, or the name of a set `[observer.NAME]` in the file of the
            joint.
        controller: gains of the controller by joint.
        printed_estimate: start the observer as in (103) of the paper.
        on_machine: gains by joint that moves a whole machine, if they differ.
        in_file: whether the file of the joint has all gains, in `[gains.CONTROLLER.NAME]`.
    """

    observer: Mapping[str, Any] | str = ""
    controller: Mapping[str, Any] = field(default_factory=dict)
    printed_estimate: bool = False
    on_machine: Mapping[str, Any] = field(default_factory=dict)
    in_file: bool = False

    @property
    def has_controller_gains(self) -> bool:
        """Whether the set has gains of the controller."""
        return self.in_file or bool(self.controller)


@dataclass(frozen=True)
class Controller:
    """Controller of a joint, with its sets of gains.

    The first set is the recommended one, and the default.

    Args:
        model: block of `fmublock`, or path of an FMU.
        gains: sets of gains by name. Default: sets for the observer only; the controller keeps its start
            values.
        gain_type: class of the gains in files of joints.
        rules: functions that compute gains, by name of the set.

    Examples:
        >>> import emla_cosim as ec
        >>> ec.CONTROLLERS["foc"].recommended
        'damped'
    """

    model: type[Block] | Path
    gains: Mapping[str, Gains] = field(
        default_factory=lambda: {name: Gains(name) for name in ("compensated", "robust", "published")}
    )
    gain_type: type | None = None
    rules: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    @property
    def recommended(self) -> str:
        """Name of the recommended set of gains."""
        return next(iter(self.gains))


def _build_file_sets(*names: str) -> Mapping[str, Gains]:
    """Return sets of gains by name, all of which are in the files of joints."""
    return {name: Gains(in_file=True) for name in names}


CONTROLLERS: dict[str, Controller] = {
    "rsba": Controller(
        RsbaController,
        _build_file_sets("damped", "compensated", "robust", "published", COMPLIANT),
        gains.RsbaGains,
        {"robust": gains.robust, "compensated": gains.compensated, "damped": gains.damped},
    ),
    "foc": Controller(
        FocController,
        _build_file_sets("damped", "tuned", "rule", COMPLIANT),
        foc_gains.FocGains,
        {"tuned": foc_gains.tuned, "rule": foc_gains.rule},
    ),
    "cac": Controller(
        CacController,
        _build_file_sets("damped", "tuned", "published", COMPLIANT),
        cac_gains.CacGains,
        {"tuned": cac_gains.tuned},
    ),
    "anatc": Controller(
        AnatcController,
        _build_file_sets("damped", "tuned", "published", COMPLIANT),
        anatc_gains.AnatcGains,
        {"tuned": anatc_gains.tuned},
    ),
}
"""Controllers by name; add your own here to use it by name.

The recommended sets are comparable: they meet the conditions of the tunings, which start from them.
"""

ROBUSTNESS_SETS = ("robust", "rule")
"""Further sets in tables of robustness, which were not tuned."""


def choose_controller(
    controller: str | type | None, gain_set: str | None, preferred: str | None = None
) -> "ControllerWithGains":
    """Return a controller with one of its sets of gains.

    Args:
        controller: A name, FILE.fmu, FILE.py:BLOCK, or a block.
        gain_set: The name of the set; None for the preferred one, or the recommended one.
        preferred: The set to use without `gain_set`, if the controller has it.

    Raises:
        CommandError: The controller or the set does not exist, or a class is not a block.
    """
    choice = "rsba" if controller is None else controller
    entry = _find_controller(choice)
    if gain_set is not None:
        check_choice("set of gains", gain_set, entry.gains)
    name = choice if isinstance(choice, str) else choice.__name__
    default = preferred if preferred is not None and preferred in entry.gains else entry.recommended
    return ControllerWithGains(entry, name, gain_set or default)


@dataclass(frozen=True)
class ControllerWithGains:
    """A controller, its name, and the name of one of its sets of gains."""

    controller: Controller
    name: str
    gain_set: str

    @property
    def gains(self) -> Gains:
        """The set of gains."""
        return self.controller.gains[self.gain_set]


def _find_controller(name: str | type) -> Controller:
    """Return a registered controller, or a new one for a block, FILE.fmu or FILE.py:BLOCK."""
    if isinstance(name, type):
        if not issubclass(name, Block):
            raise CommandError(
                f"the controller {name.__name__} is not a block of fmublock; pass a subclass of its Block."
            )
        return Controller(name)
    if name.lower().endswith(".fmu"):
        return Controller(Path(name))
    if ".py:" in name:
        return Controller(find_block(name))
    sets = dict.fromkeys(s for controller in CONTROLLERS.values() for s in controller.gains)
    if name in sets and name not in CONTROLLERS:
        raise CommandError(
            f"'{name}' is a set of gains, not a controller; write gains = \"{name}\", or --gains {name}.",
            name=name,
        )
    if name not in CONTROLLERS:
        raise CommandError(
            f"there is no controller '{name}'; choose from {join_names(CONTROLLERS)}, or write FILE.fmu or "
            "FILE.py:BLOCK.",
            name=name,
        )
    return CONTROLLERS[name]

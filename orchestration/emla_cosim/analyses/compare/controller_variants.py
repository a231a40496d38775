"""The controllers to compare, each with one or more of its sets of gains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...base.errors import CommandError, join_names
from ...base.values import convert_value
from ...study.controllers import CONTROLLERS, choose_controller

ALL, RECOMMENDED = "all", "recommended"
"""Keywords for all sets of gains of a controller, and for its recommended set."""

Choice = str | type
"""A controller: its name, FILE.fmu, FILE.py:BLOCK, or a block."""


@dataclass(frozen=True)
class ControllerVariant:
    """A controller and one set of its gains."""

    controller: Choice
    gains: str

    @property
    def label(self) -> str:
        """The name of the controller, or that of its file or block."""
        return label_controller(self.controller)

    def __str__(self) -> str:
        return f"{self.label}/{self.gains}"


def label_controller(controller: Choice) -> str:
    """Return the name of a controller for tables."""
    return controller if isinstance(controller, str) else controller.__name__


def select_variants(
    controllers: Sequence[Choice] | None = None,
    gains: Sequence[str] | None = None,
    also: Sequence[str] = (),
    preferred: str | None = None,
) -> list[ControllerVariant]:
    """Return the controllers, by default all of `CONTROLLERS`, with the sets of gains to compare.

    Controllers without a named set use their recommended set.

    Args:
        controllers: Names, FMUs or blocks.
        gains: SET (of each controller that has it), CONTROLLER/SET, "recommended" or "all".
        also: Sets to add if `gains` is empty, for controllers of `CONTROLLERS` that have them.
        preferred: Set that is the recommended one of each controller that has it.

    Raises:
        CommandError: A controller or a set does not exist, or no compared controller has the set.
    """
    names = list(dict.fromkeys(_check_controllers(controllers)))
    choices = {controller: choose_controller(controller, None, preferred) for controller in names}
    sets = {controller: list(default.controller.gains) for controller, default in choices.items()}
    defaults = {controller: default.gain_set for controller, default in choices.items()}
    texts = convert_value(gains or (), Sequence[str], "the list of gains to compare")
    selected = _find_sets(texts, sets, defaults)
    if not gains:
        for controller in (c for c in names if c in CONTROLLERS):
            selected[controller] = {defaults[controller], *also}
    return [
        ControllerVariant(controller, gain_set)
        for controller in names
        for gain_set in ([s for s in sets[controller] if s in selected[controller]] or [defaults[controller]])
    ]


def list_other_variants(compared: Sequence[ControllerVariant]) -> list[str]:
    """Return sets of gains of the compared controllers that are not compared, as CONTROLLER/SET."""
    labels = set(map(str, compared))
    controllers = dict.fromkeys(variant.label for variant in compared if variant.controller in CONTROLLERS)
    return [s for c in controllers for s in (f"{c}/{g}" for g in CONTROLLERS[c].gains) if s not in labels]


def _check_controllers(controllers: Sequence[Choice] | None) -> list[Choice]:
    if controllers is None:
        return list(CONTROLLERS)
    if isinstance(controllers, (str, type)) or not isinstance(controllers, Sequence) or not controllers:
        raise CommandError(
            f"the controllers to compare are {controllers!r}; they must be a list of one or more."
        )
    if wrong := [each for each in controllers if not isinstance(each, (str, type))]:
        raise CommandError(f"a controller to compare is {wrong[0]!r}; it must be a name, a file or a block.")
    return list(controllers)


def _find_sets(
    gains: Sequence[str], sets: Mapping[Choice, Sequence[str]], defaults: Mapping[Choice, str]
) -> dict[Choice, set[str]]:
    """Return the named sets of each controller."""
    selected: dict[Choice, set[str]] = {controller: set() for controller in sets}
    for text in gains:
        label, slash, gain_set = text.rpartition("/")
        owners = [c for c in sets if label_controller(c) == label] if slash else list(sets)
        if not owners:
            raise CommandError(
                f"the gains {text} are for the controller '{label}', which is not compared; "
                f"compared {_join_with_verb([label_controller(c) for c in sets])}.",
                name=text,
            )
        keywords = {ALL: sets, RECOMMENDED: {c: [default] for c, default in defaults.items()}}
        matches = {
            c: keywords[gain_set][c] if gain_set in keywords else {gain_set} & {*sets[c]} for c in owners
        }
        if not any(matches.values()):
            existing = list(dict.fromkeys(name for c in owners for name in sets[c]))
            raise CommandError(
                f"the controller {label} has no set of gains '{gain_set}'; it has {join_names(existing)}."
                if slash
                else f"no controller that is compared has the set of gains '{gain_set}'; there "
                f"{_join_with_verb(existing)}.",
                name=text,
            )
        for controller, names in matches.items():
            selected[controller] |= set(names)
    return selected


def _join_with_verb(names: Sequence[str]) -> str:
    return f"{'is' if len(names) == 1 else 'are'} {join_names(names)}"

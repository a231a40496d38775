"""Who is compared: controllers, each with one or more sets of its gains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..base.errors import CommandError, join_names
from ..base.values import convert_value
from ..study.controllers import CONTROLLERS, choose_controller

ALL, RECOMMENDED = "all", "recommended"
"""Words for all sets of gains that a controller has, and for its recommended one."""

Choice = str | type
"""A controller by its name, as FILE.fmu or FILE.py:BLOCK, or as a block."""


@dataclass(frozen=True)
class ControllerVariant:
    """A controller and one set of its gains."""

    controller: Choice
    gains: str

    @property
    def label(self) -> str:
        """The controller's name, or that of its file or block."""
        return label_controller(self.controller)

    def __str__(self) -> str:
        return f"{self.label}/{self.gains}"


def label_controller(controller: Choice) -> str:
    """What tables call a controller."""
    return controller if isinstance(controller, str) else controller.__name__


def select_variants(
    controllers: Sequence[Choice] | None = None,
    gains: Sequence[str] | None = None,
    also: Sequence[str] = (),
) -> list[ControllerVariant]:
    """Return controllers, by default all of `CONTROLLERS`, with the sets of gains that are named.

    A set is named as SET, for every controller that has it, as CONTROLLER/SET for one, as "recommended" or
    as "all". A controller for which none is named comes with its recommended set. Where no gains are named
    at all, controllers of ours come with the sets of `also`, too, if they have them. Raises CommandError
    for a controller or a set that does not exist, or that no compared controller has.
    """
    names = list(dict.fromkeys(_controllers(controllers)))
    sets = {one: list(choose_controller(one, None).controller.gains) for one in names}
    named = _check_sets(convert_value(list(gains or ()), Sequence[str], "the gains to compare"), sets)
    if not gains:
        for one in (c for c in names if c in CONTROLLERS):
            named[one] = {sets[one][0], *also}
    return [
        ControllerVariant(one, gain_set)
        for one in names
        for gain_set in ([s for s in sets[one] if s in named[one]] or sets[one][:1])
    ]


def list_other_variants(compared: Sequence[ControllerVariant]) -> list[str]:
    """Return the sets of gains, as CONTROLLER/SET, that compared controllers of ours have beside these."""
    taken = set(map(str, compared))
    ours = dict.fromkeys(one.label for one in compared if one.controller in CONTROLLERS)
    return [s for c in ours for s in (f"{c}/{g}" for g in CONTROLLERS[c].gains) if s not in taken]


def _controllers(given: Sequence[Choice] | None) -> list[Choice]:
    if given is None:
        return list(CONTROLLERS)
    if isinstance(given, (str, type)) or not isinstance(given, Sequence) or not given:
        raise CommandError(f"the controllers to compare are {given!r}; they must be a list of one or more.")
    if wrong := [one for one in given if not isinstance(one, (str, type))]:
        raise CommandError(f"a controller to compare is {wrong[0]!r}; it must be a name, a file or a block.")
    return list(given)


def _check_sets(gains: Sequence[str], sets: Mapping[Choice, Sequence[str]]) -> dict[Choice, set[str]]:
    """The sets that are named for each controller."""
    named: dict[Choice, set[str]] = {one: set() for one in sets}
    for text in gains:
        one, slash, gain_set = text.rpartition("/")
        owners = [c for c in sets if label_controller(c) == one] if slash else list(sets)
        if slash and not owners:
            raise CommandError(
                f"the gains {text} are for the controller '{one}', which is not compared; "
                f"compared {_join_with_verb([label_controller(c) for c in sets])}.",
                name=text,
            )
        words = {ALL: slice(None), RECOMMENDED: slice(1)}
        found = {c: sets[c][words[gain_set]] if gain_set in words else [gain_set] for c in owners}
        having = {c: names for c, names in found.items() if set(names) <= set(sets[c])}
        if not having:
            there = dict.fromkeys(s for c in owners for s in sets[c])
            raise CommandError(
                f"no controller that is compared has the set of gains '{gain_set}'; there "
                f"{_join_with_verb(there)}."
                if not slash
                else f"the controller {one} has no set of gains '{gain_set}'; it has {join_names(there)}.",
                name=text,
            )
        for c, names in having.items():
            named[c] |= set(names)
    return named


def _join_with_verb(names: Sequence[str] | Mapping[str, None]) -> str:
    return f"{'is' if len(names) == 1 else 'are'} {join_names(names)}"

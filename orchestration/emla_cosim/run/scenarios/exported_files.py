"""Kinds of files that a scenario is exported to, and the options that each has no place for."""

from collections.abc import Collection
from pathlib import Path

from ...base.errors import CommandError
from ..options import Options, list_options

SSP, FMU, C = ".ssp", ".fmu", ".c"
"""Ends of names; a file with another end is an SSP."""

NAMES = {SSP: "an SSP", FMU: "an FMU", C: "a C file"}
"""What messages call them."""

_STEPPED = ("algorithm", "extrapolation", "step_multiples", "order", "coupling_tolerance")
_ASKED_FOR = ("no_event_mode", "fmi", "inputs", "outputs", "components", "precision", "platform")
"""Options whose value was asked for if it is not the default, also in a scenario file: all of exports only,
and one that would silently change results."""

_NOT_IN = {
    SSP: (*_STEPPED, "no_event_mode", "fmi", "inputs", "outputs", "components", "precision"),
    FMU: ("components", "precision"),
    C: ("no_event_mode", "fmi", "inputs", "platform"),
}


def find_kind(file: Path) -> str:
    """Return the kind of a file by its name."""
    end = file.suffix.lower()
    return end if end in NAMES else SSP


def refuse_unsuited(kind: str, given: Collection[str]) -> None:
    """Raise CommandError if an option was given that a kind of file has no place for."""
    if others := [name for name in _NOT_IN[kind] if name in given]:
        flag = list_options()[others[0]].flag
        ends = [end for end, names in _NOT_IN.items() if others[0] not in names]
        raise CommandError(
            f"{NAMES[kind]} cannot hold {flag}; leave it out, or export to a file that ends in "
            f"{' or '.join(ends)}."
        )


def list_asked_for(options: Options) -> list[str]:
    """Return the options of `_ASKED_FOR` that differ from their defaults."""
    usual = Options()
    return [name for name in _ASKED_FOR if getattr(options, name) not in (getattr(usual, name), False)]

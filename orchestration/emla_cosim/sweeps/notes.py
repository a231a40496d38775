"""Collect warnings to show before a sweep, on its scenario and its extreme variants."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

from ..base.errors import CommandError
from .design import Design, VariantGroup
from .factors import Factor
from .targets import merge_options, needs_preparation

_NUMBER = re.compile(r"[-+]?[0-9][0-9.,]*(e[-+]?[0-9]+)?")


def sweep_notes(design: Design) -> list[str]:
    """Return warnings without periods, each once.

    Those on the scenario come first, then those on variants with all factors at one end of their ranges.
    """
    found: dict[str, str] = {}
    for group in design.groups:
        for note in _notes(group):
            found.setdefault(_NUMBER.sub("#", note), note)
    return list(found.values())


def _notes(group: VariantGroup) -> Iterator[str]:
    scenario = group.preparation.scenario
    if scenario is None:
        return
    yield from scenario.notes
    for end in (1, 0):  # high end first: high loads, speeds and strokes are the critical ones
        try:
            variant = scenario.with_options(_at_ends(group.factors, end))
        except CommandError as error:  # a single run would fail with this message
            yield f"some variants cannot run: {str(error).strip().rstrip('.')}"
            continue
        yield from variant.notes


def _at_ends(factors: Sequence[Factor], end: int) -> dict[str, Any]:
    """Return the options of a variant with all factors at their low (0) or high end (1)."""
    changing = [f for f in factors if not any(needs_preparation(target) for target in f.targets)]
    return merge_options(f.options(f.value(f.distribution.ends[end])) for f in changing)

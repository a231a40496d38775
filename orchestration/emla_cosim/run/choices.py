"""The algorithm, step-size control and recorders of a run, resolved from values that override each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from ..base.option import options_of
from ..base.wording import has_wildcard, matches_pattern
from ..master.algorithms.registry import ALGORITHMS
from ..master.stepping.step_size_control import STEP_SIZE_CONTROLS

CHOICES: Mapping[str, Mapping[str, type]] = {"algorithm": ALGORITHMS, "step_size_control": STEP_SIZE_CONTROLS}
"""The options that choose a class, with the classes, each of which has options of its own."""

_IMPLIED = "step_size_control"
"""The choice that follows from the options that are set, if nothing is chosen."""


@dataclass(frozen=True)
class Resolution:
    """What layers of values mean together.

    Attributes:
        values: Values of the options that apply, by name.
        unused: Options that a later choice of a class does not have, with the name of the option that chose.
        layers: Values that were resolved.
    """

    values: Mapping[str, Any]
    unused: Mapping[str, str] = field(compare=False)
    layers: Sequence[Mapping[str, Any]] = field(compare=False, repr=False)


def resolve(layers: Sequence[Mapping[str, Any]]) -> Resolution:
    """Return the values of options that apply.

    A later value replaces an earlier one; tables are merged. A later algorithm or step-size control removes
    earlier options that it does not have. A later option of a step-size control removes an earlier choice of
    one that does not have it.

    Args:
        layers: Values from `read_options` by name, such as those of a file and of the command line.
    """
    starts = {name: _find_choice(name, layers) for name in CHOICES}
    unused = {
        name: choice
        for choice, (start, lacking) in starts.items()
        for layer in layers[:start]
        for name in layer
        if name in lacking
    }
    values = dict[str, Any]()
    for number, layer in enumerate(layers):
        for name, value in layer.items():
            if name not in unused or number >= starts[unused[name]][0]:
                values[name] = merge_value(values.get(name), value)
    # a later option of another step-size control chooses that control
    start, lacking = starts[_IMPLIED]
    if values.get(_IMPLIED) is not None and not lacking.isdisjoint(chain(*layers[start + 1 :])):
        values[_IMPLIED] = None
    return Resolution(values, {n: choice for n, choice in unused.items() if n not in values}, layers)


def _find_choice(name: str, layers: Sequence[Mapping[str, Any]]) -> tuple[int, set[str]]:
    """Return the last layer that chooses a class, and the options of other classes that this one lacks.

    These are 0 and no options if no layer chooses a class, or the last one withdraws the choice.
    """
    for number, layer in reversed([*enumerate(layers)]):
        if name in layer and (choice := layer[name]) is not None:
            kinds = CHOICES[name]
            has = list_option_names(kinds[choice]) if isinstance(choice, str) else set[str]()
            return number, list_option_names(*kinds.values()) - has
        if name in layer:  # an explicit None withdraws earlier choices
            break
    return 0, set()


def merge_value(before: Any, later: Any) -> Any:
    """Return the later value. Two tables are merged; a pattern replaces the entries that it matches."""
    if not (isinstance(later, Mapping) and before):
        return later
    patterns = [name for name in later if has_wildcard(name)]
    remaining = {
        n: v for n, v in before.items() if n not in later and not any(matches_pattern(n, p) for p in patterns)
    }
    return {**remaining, **later}


def list_option_names(*kinds: type) -> set[str]:
    """Return the names of the options that classes have."""
    return {option.name for kind in kinds for option in options_of(kind)}

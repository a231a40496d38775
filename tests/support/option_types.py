"""Write the types of options, from their table: `python -m tests.support.option_types`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin

from emla_cosim.base.option import COMPARE, SHARING, SHOWING, SWEEP, Option
from emla_cosim.inputs.input import Input
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.stepping.step_size_control import StepSizeControl
from emla_cosim.recorders.tubes.tolerance import Tolerance
from emla_cosim.run.options import list_options
from emla_cosim.system.fault import Fault
from emla_cosim.system.model import Replacement
from tests.support.paths import ROOT

FILE = ROOT / "orchestration/emla_cosim/run/option_types.py"

HEAD = '''\
"""Types of the options that Python takes as keyword arguments, made of the fields of `Options`.

Change the fields, then run `python -m tests.support.option_types`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ..base.option import FileOrObject
from ..inputs.input import Input
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.step_size_control import StepSizeControl
from ..recorders.tubes.tolerance import Tolerance
from ..system.fault import Fault
from ..system.model import Replacement, Value
'''


def class_definitions() -> list[tuple[str, str, str, dict[str, Option]]]:
    """Return name, base, docstring and options of each class, without those of the base."""
    every = {n: o for n, o in list_options().items() if o.about.stage != SHOWING}
    shared = {n for n, o in every.items() if o.about.stage == SHARING}
    run = {n for n, o in every.items() if not o.is_prepared} - shared
    prepare = {n for n, o in every.items() if not o.about.makes} - shared
    swept = set(list_options(SWEEP)) & set(every) - {"overwrite"}  # an argument of its own
    compared = set(list_options(COMPARE)) & set(every) - {"overwrite"}
    tuned = swept - {"require"}  # an argument of its own
    assert compared < tuned
    assert run < prepare
    parts = [
        ("RunOptions", "TypedDict", "Options of `Simulation.run`, `attempt` and `start`.", run),
        ("PrepareOptions", "RunOptions", "Options of `Scenario.prepare` and `export`.", prepare - run),
        ("LoadOptions", "PrepareOptions", "Options of `load` and `info`.", set(every) - prepare - shared),
        ("CompareOptions", "TypedDict", "Options of `compare`.", compared),
        ("TuneOptions", "CompareOptions", "Options of `tune`.", tuned - compared),
        ("SweepOptions", "TuneOptions", "Options of `sweep`.", swept - tuned),
    ]
    return [
        (name, base, said, {n: o for n, o in every.items() if n in own}) for name, base, said, own in parts
    ]


def accepted_type(option: Option) -> str:
    """Return what `read_option` accepts for an option, as the text of an annotation."""
    if option.about.arrays:
        return "Mapping[str, Value | np.generic | Sequence[Value] | NDArray[Any]]"
    more = [str] * bool(option.about.unit) + [bool] * bool(option.about.alone)
    return " | ".join(_union([*_parts(option.type), *more]))


def _parts(type_: Any) -> tuple[Any, ...]:
    """Return the members of a union, or the type alone."""
    return get_args(type_) if get_origin(type_) not in (None, Mapping, Sequence) else (type_,)


def _union(types: Iterable[Any]) -> dict[str, None]:
    """Return the texts of all that these types accept, each once, None last."""
    found: dict[str, None] = {}
    for type_ in sorted(types, key=lambda t: t is NoneType):
        found |= dict.fromkeys(_texts(type_))
    return found


def _texts(type_: Any) -> list[str]:
    if get_origin(type_) is Mapping:
        return [f"Mapping[str, {' | '.join(_union(_parts(get_args(type_)[1])))}]"]
    if get_origin(type_) is Sequence:
        return [f"Sequence[{' | '.join(_union(_parts(get_args(type_)[0])))}]"]
    if type_ is NoneType:
        return ["None"]
    if type_ is Path:
        return ["str", "Path"]
    if not is_dataclass(type_) or issubclass(type_, (Algorithm, StepSizeControl)):
        return [type_.__name__]
    texts = {Input: ["str", "Path"], Replacement: ["str", "Path"], Fault: ["str"], Tolerance: ["float"]}
    return [type_.__name__, *texts[type_], "Mapping[str, Any]"]


def module_text() -> str:
    """Return the whole module."""
    text = HEAD
    for name, base, said, options in class_definitions():
        fields = "".join(f"    {n}: {accepted_type(o)}\n" for n, o in options.items())
        text += f'\n\nclass {name}({base}, total=False):\n    """{said}"""\n\n{fields}'
    return text


if __name__ == "__main__":
    FILE.write_text(module_text(), encoding="utf-8")

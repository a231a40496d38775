"""Write components of a system as plain C."""

import math
import re
from collections.abc import Collection, Mapping
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from fmublock import instance
from fmublock.c_equations import HELPERS
from fmublock.compiling import c_number, c_text

from ..base.errors import CommandError
from ..base.output_files import OutputFile
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.program import Call
from ..master.stepping.timing import CommunicationPoints
from ..system.model import System
from .plan import CodePlan, make_identifier, plan_code

MARK = "/* Written by EMLA-Cosim:"
"""Start of both files, by which they are recognized."""

DOUBLE, FLOAT = PRECISIONS = ("double", "float")
"""Types of all numbers."""

_LARGEST_WHOLE = 2**24
"""Largest whole number below which float has all whole numbers."""

_NUMBER = r"(?<![\w.])(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|(?<![\w.])\d+[eE][-+]?\d+"

_TOKEN = re.compile(
    rf'(?P<text>/\*.*?\*/|"(?:\\.|[^"\\])*")|(?P<type>\bdouble\b)|(?P<number>{_NUMBER})', re.DOTALL
)
"""The tokens that a change of the type replaces, and comments and texts, which it skips."""


def render_header(plan: CodePlan, precision: str) -> str:
    """Return the header."""
    return _render("code.h.jinja", plan, precision)


def render_source(plan: CodePlan, precision: str) -> str:
    """Return the source.

    Raises:
        CommandError: The equations contain large whole numbers, as random numbers do, and float is requested.
    """
    equations = "\n".join(text for block in plan.blocks for text in block.functions)
    if precision == FLOAT:  # a float would round the states of random numbers
        _check_float(plan, equations)
    text = _render(
        "code.c.jinja",
        plan,
        precision,
        network=plan.system.network,
        connections=[_format_connected_inputs(plan, i) for i in range(len(plan.parts))],
        helpers=[text for name, text in HELPERS.items() if re.search(rf"\b{name}\(", equations)],
        same_count=c_number(instance.SAME_COUNT),
        shim=lambda name: files("fmublock").joinpath("shim", name).read_text(encoding="utf-8"),
        isfinite=math.isfinite,
        Call=Call,
    )
    return _replace_types(text, plan.name, precision)


def _render(template: str, plan: CodePlan, precision: str, **context: Any) -> str:
    """Return a file; `precision` is the type of numbers that the filter `typed` writes."""
    environment = Environment(
        loader=PackageLoader(__package__ or "", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "comment": _format_comment,
        "number": c_number,
        "quote": c_text,
        "room": partial(max, 1),  # C has no empty arrays
        "typed": lambda number: _replace_types(c_number(number), plan.name, precision),
    }
    context |= {"mark": MARK, "name": plan.name, "plan": plan, "precision": precision}
    return environment.get_template(template).render(context)


def _format_connected_inputs(plan: CodePlan, i: int) -> list[tuple[int, str, str]]:
    """Return the value reference of each connected input, the expression of its value in C, and its name."""
    network, lines = plan.system.network, list[tuple[int, str, str]]()
    for j, variable in enumerate(plan.system.parts[i].instance.read):
        factor, offset = float(network.factors[i][j]), float(network.offsets[i][j])
        value = f"m->signals[{int(network.sources[i][j])}]"
        value = value if factor == 1.0 else f"{c_number(factor)} * {value}"
        value = value if offset == 0.0 else f"{value} + {c_number(offset)}"
        if variable.type == "Boolean":
            value = f"rint({value}) != 0"
        elif variable.type != "Real":
            value = f"rint({value})"
        lines.append((int(variable.valueReference), value, str(variable.name)))
    return lines


def _check_float(plan: CodePlan, equations: str) -> None:
    """Raise CommandError if the equations contain a whole number that a float cannot hold."""
    numbers = map(float, re.findall(_NUMBER, equations))
    large = [x for x in numbers if x == int(x) and _LARGEST_WHOLE < abs(x) < 1e15]
    if large:
        raise CommandError(
            f"the equations of {plan.name} contain the whole number {large[0]:.0f}, as random numbers do; "
            "float has them only up to 16777216. Use --precision double."
        )


def _replace_types(text: str, name: str, precision: str) -> str:
    """Return C with numbers of the type that the header defines, outside of comments and texts."""

    def replace(token: re.Match[str]) -> str:
        if token["type"]:
            return f"{name}_real"
        return f"{token[0]}f" if token["number"] and precision == FLOAT else token[0]

    return _TOKEN.sub(replace, text)


def _format_comment(text: str) -> str:
    """Return a text that does not end a comment, in ASCII."""
    plain = text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ")
    return plain.encode("ascii", "backslashreplace").decode()


def list_files(path: Path) -> tuple[Path, Path]:
    """Return the source and its header.

    Raises:
        CommandError: The file's name is not a name in C.
    """
    if make_identifier(path.stem) != path.stem or not re.fullmatch(r"[A-Za-z]\w*", path.stem, re.ASCII):
        raise CommandError(
            f"'{path.stem}' begins all names in C: it must have letters, digits and _ only, begin with "
            "a letter, not end with _, and not be a reserved word. Write a file such as control.c."
        )
    return path, path.with_suffix(".h")


def check_code(path: Path, overwrite: bool = False) -> list[OutputFile]:
    """Return the files, which may be written. Raises CommandError if one must not be replaced."""
    return [
        OutputFile(file, "the C file", _is_ours, overwrite, creates_folder=True) for file in list_files(path)
    ]


def _is_ours(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(MARK)) == MARK.encode()


def write_code(
    path: Path,
    system: System,
    fmus: Mapping[str, Path],
    components: Collection[str],
    algorithm: Algorithm,
    times: CommunicationPoints,
    outputs: Collection[str],
    precision: str,
    overwrite: bool = False,
) -> None:
    """Write components as a C file and its header.

    Args:
        path: The C file.
        system: The system, with its start values.
        fmus: FMU file of every component.
        components: Names or patterns of the components.
        algorithm: The algorithm that steps the system.
        times: Start, stop and step size.
        outputs: Names or patterns of the outputs. Default: those that drive other components, else all.
        precision: Type of all numbers, one of `PRECISIONS`.
        overwrite: Whether to replace files that emla did not write.

    Raises:
        CommandError: The components cannot be plain C, or a file must not be replaced.
        RunError: They cannot be initialized, or a file cannot be written.
    """
    source, header = check_code(path, overwrite)
    plan = plan_code(path.stem, system, fmus, components, algorithm, times, outputs)
    # both before one is written, because rendering can fail
    texts = render_header(plan, precision), render_source(plan, precision)
    for file, text in zip((header, source), texts, strict=True):
        file.write(text.encode())

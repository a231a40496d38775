"""The content of components as plain C: their blocks, and the order of their calls."""

import keyword
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmublock import Block
from fmublock.block import Layout
from fmublock.c_equations import CEquations, c_equations
from fmublock.errors import BuildError
from fmublock.symbolic import evaluate_symbolically
from fmublock.variables import ScalarVariable

from ..base.errors import CommandError, join_names
from ..base.wording import find_free_name, matches_pattern, select_names
from ..container.plan import ContainerPlan, plan_container
from ..fmu.models import find_block
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.timing import CommunicationPoints
from ..system.model import Component, System

_WORDS = {
    *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum"),
    *("extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return"),
    *("short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void"),
    *("volatile", "while"),
}
"""Reserved words of C."""


@dataclass(frozen=True)
class CodeBlock:
    """A block, whose functions all of its components call.

    Attributes:
        name: its class, with a number if several have this name; begins the names of its functions.
        layout: its variables.
        internal_step: value reference of its longest internal step; None without states.
        equations: its equations in C.
        demands: the messages of its conditions.
    """

    name: str
    layout: Layout
    internal_step: int | None
    equations: CEquations
    demands: Sequence[str]

    @property
    def functions(self) -> list[str]:
        """Return the functions that are called, with the name of the block before theirs."""
        layout, functions = self.layout, self.equations.functions
        used = ["fixed_values", *(["stepwise_values", "derivatives"] if layout.states else [])]
        used += [*(["outputs"] if layout.outputs else []), "update_and_outputs"]
        used += ["conditions"] if self.demands else []
        return [functions[name].replace(f" {name}(", f" {self.name}_{name}(", 1) for name in used]


@dataclass(frozen=True)
class CodePart:
    """A component.

    Attributes:
        name: its name in the system.
        field: its name in C.
        block: its block.
        starts: its start values by value reference.
    """

    name: str
    field: str
    block: CodeBlock
    starts: Sequence[float]


@dataclass(frozen=True)
class CodeVariable:
    """A variable in the interface of the C code.

    Attributes:
        field: its name in C.
        part: its component.
        reference: its value reference.
    """

    field: str
    part: CodePart
    reference: int

    @property
    def scalar(self) -> ScalarVariable:
        """Return its declaration in the block."""
        return self.part.block.layout.scalars[self.reference]

    @property
    def name(self) -> str:
        """Return its name in the system."""
        return f"{self.part.name}.{self.scalar.name}"


@dataclass(frozen=True)
class CodePlan:
    """The content of the C code.

    Attributes:
        name: prefix of everything in C.
        system: the components with their connections, as the FMU of a system has them.
        parts: the components.
        blocks: their blocks, each once.
        inputs: the variables that the caller sets in each step.
        outputs: the variables that a step returns.
        parameters: the variables that the caller may set before the start.
        step: time in s between two calls.
    """

    name: str
    system: ContainerPlan
    parts: Sequence[CodePart]
    blocks: Collection[CodeBlock]
    inputs: Sequence[CodeVariable]
    outputs: Sequence[CodeVariable]
    parameters: Sequence[CodeVariable]
    step: float

    @property
    def assumed_signals(self) -> list[float]:
        """Return the signals that agree with the start values of the inputs that read them, otherwise 0.

        This overwrites the signals and inputs of the network.
        """
        network = self.system.network
        network.signals[:] = 0.0
        for i, part in enumerate(self.system.parts):
            network.instances[i].inputs[:] = part.instance.input_starts
            network.assume_inputs(i)
        return network.signals.tolist()


def plan_code(
    name: str,
    system: System,
    fmus: Mapping[str, Path],
    components: Collection[str],
    algorithm: Algorithm,
    times: CommunicationPoints,
    outputs: Collection[str] = (),
) -> CodePlan:
    """Prepare components of a system, initialize them once, and return what their C code needs.

    Args:
        name: Prefix of everything in C.
        system: The system, with its start values.
        fmus: FMU file of every component.
        components: Names or patterns of the components; `controller` also matches `lift.controller`.
        algorithm: The algorithm that steps the system.
        times: Start, stop and step size.
        outputs: Names or patterns of the outputs. Default: those that drive other components, else all.

    Raises:
        CommandError: The components cannot be plain C.
        RunError: They cannot be initialized.
    """
    chosen_components = _choose_components(system, components)
    names = [c.name for c in chosen_components]
    inside = [x for x in system.connections if {x.ends[0][0], x.ends[1][0]} <= {*names}]
    # bonds may be of components that are left out
    reduced_system = replace(system, components=tuple(chosen_components), connections=tuple(inside), bonds={})
    models = {c.name: _find_block(c) for c in chosen_components}
    reduced_algorithm = _restrict_algorithm(algorithm, names)
    plan = plan_container(reduced_system, {n: fmus[n] for n in names}, reduced_algorithm, times)
    multiple = _find_common_multiple(plan, reduced_algorithm)
    fields = dict(zip(names, _name_parts(names), strict=True))
    blocks = _write_blocks(models[part.name] for part in plan.parts)
    parts = [
        CodePart(
            part.name, fields[part.name], block := blocks[models[part.name]], _list_starts(plan, p, block)
        )
        for p, part in enumerate(plan.parts)
    ]
    driven = {f"{part.name}.{v.name}" for part in plan.parts for v in part.instance.read}
    # inputs of the components that are left out
    driving = {".".join(x.ends[0]) for x in system.connections if x.ends[1][0] not in names}
    written = [v.name for v in _list_variables(parts, "outputs")]
    return CodePlan(
        name=name,
        system=plan,
        parts=parts,
        blocks=blocks.values(),
        inputs=_list_variables(parts, "inputs", {v.name for v in _list_variables(parts, "inputs")} - driven),
        outputs=_list_variables(parts, "outputs", _choose_outputs(written, outputs, driving)),
        parameters=_list_variables(parts, "parameters"),
        step=times.clock.point(multiple) - times.clock.point(0),
    )


def _choose_components(system: System, patterns: Collection[str]) -> list[Component]:
    """Return the components that match patterns; CommandError without patterns, and if one matches none."""
    names = [c.name for c in system.components]
    available = f"there are {join_names(names)}."
    if not patterns:
        raise CommandError(f"plain C needs --components, such as --components controller; {available}")
    names_to_keep = set[str]()
    for pattern in patterns:
        matches = [n for n in names if matches_pattern(n, pattern) or matches_pattern(n, f"*.{pattern}")]
        if not matches:
            raise CommandError(f"no component matches '{pattern}' of --components; {available}", name=pattern)
        names_to_keep.update(matches)
    return [c for c in system.components if c.name in names_to_keep]


def _choose_outputs(names: Sequence[str], patterns: Collection[str], driving: Collection[str]) -> list[str]:
    """Return the selected outputs, else those that drive others, else all."""
    if not patterns:
        return [name for name in names if name in driving] or list(names)
    selected = select_names(patterns, names, "output")
    return [name for name in names if name in selected]


def _find_block(component: Component) -> type[Block]:
    """Return the block of a component. Raise CommandError if it is an FMU file."""
    if not component.model:
        raise CommandError(f"{component.name} is an FMU file; only blocks of Python can be plain C.")
    block = find_block(component.model) if isinstance(component.model, str) else component.model
    return block if isinstance(block, type) else type(block)


def _restrict_algorithm(algorithm: Algorithm, names: Collection[str]) -> Algorithm:
    """Return the algorithm for some of the components."""
    # its `setup` refuses options of components that do not exist
    changes: dict[str, Any] = {}
    if order := getattr(algorithm, "order", None):
        changes["order"] = [n for n in order if n in names]
    if multiples := getattr(algorithm, "step_multiples", None):
        changes["step_multiples"] = {n: m for n, m in multiples.items() if n in names}
    return replace(algorithm, **changes) if changes else algorithm


def _find_common_multiple(plan: ContainerPlan, algorithm: Algorithm) -> int:
    """Return the common step multiple; CommandError if the components cannot be plain C."""
    if plan.groups:
        raise CommandError("plain C has no strong coupling; add --algorithm gauss-seidel.")
    if not algorithm.is_plain:
        raise CommandError(
            f"plain C cannot combine values as {type(algorithm).__name__} does; choose another algorithm."
        )
    if any(part.mode for part in plan.parts):
        raise CommandError("plain C does not extrapolate inputs; add --extrapolation none.")
    if loops := [g for g in plan.initial_groups if len(g.coupling)]:
        names = join_names([plan.parts[i].name for i in loops[0].members])
        raise CommandError(f"the initial values of {names} depend on each other; plain C cannot solve them.")
    # one function does the step of all components
    multiples = {part.multiple for part in plan.parts}
    if len(multiples) > 1:
        steps = ", ".join(f"{part.name} {part.multiple}" for part in plan.parts)
        raise CommandError(f"the components have different step multiples: {steps}; export each rate alone.")
    if foreign := [x.file.path for x in plan.libraries if x.source != "fmi2_block.c"]:
        raise CommandError(f"the FMU '{foreign[0]}' has data or other code; only equations can be plain C.")
    return multiples.pop()


def _write_blocks(models: Iterable[type[Block]]) -> dict[type[Block], CodeBlock]:
    """Return the blocks in C."""
    # components with the same block share its functions
    models, blocks = list(dict.fromkeys(models)), {}
    try:
        for model, name in zip(models, _make_unique([m.__name__ for m in models]), strict=True):
            layout, symbolic = model().layout(), evaluate_symbolically(model())
            internal_step = layout.references((model.internal_step,))[0] if layout.states else None
            equations = c_equations(model(), symbolic)
            blocks[model] = CodeBlock(name, layout, internal_step, equations, symbolic.demands)
    except BuildError as error:
        raise CommandError(str(error)) from error
    return blocks


def _list_starts(plan: ContainerPlan, p: int, block: CodeBlock) -> list[float]:
    """Return the start values of a component: its block's, its FMU's, or those of the system."""
    part = plan.parts[p]
    starts: dict[int, Any] = {r: scalar.start for r, scalar in enumerate(block.layout.scalars)}
    declared = (v for v in part.instance.file.variables.values() if v.start is not None)
    for variable, value in [*((v, v.start) for v in declared), *part.starts]:
        if (reference := int(variable.valueReference)) in starts:  # not the derivative of a state
            starts[reference] = {"true": 1.0, "false": 0.0}.get(str(value), value)
    return [float(value) for value in starts.values()]


def _list_variables(
    parts: Sequence[CodePart], kind: str, names: Collection[str] | None = None
) -> list[CodeVariable]:
    """Return the inputs, outputs or parameters of all components: all, or those with one of these names."""
    variables = [
        CodeVariable(f"{part.field}_{make_identifier(part.block.layout.scalars[r].name)}", part, r)
        for part in parts
        for r in part.block.layout.references(getattr(part.block.layout, kind))
    ]
    selected = [v for v in variables if names is None or v.name in names]
    fields = _make_unique([v.field for v in selected])
    return [replace(v, field=field) for v, field in zip(selected, fields, strict=True)]


def _name_parts(names: Sequence[str]) -> list[str]:
    """Return names of components in C: without their joint if they all have the same one."""
    is_shared = all("." in name for name in names) and len({name.partition(".")[0] for name in names}) == 1
    return _make_unique([make_identifier(name.partition(".")[2] if is_shared else name) for name in names])


def make_identifier(name: str) -> str:
    """Return a name in C: `x[1]` is `x_1`."""
    plain = re.sub(r"\W+", "_", name.rstrip("]"), flags=re.ASCII).strip("_")
    plain = plain if re.match(r"[A-Za-z_]", plain) else f"_{plain}"
    return f"{plain}_" if plain in _WORDS or keyword.iskeyword(plain) else plain


def _make_unique(names: Sequence[str]) -> list[str]:
    """Return names in C that differ: two names such as a.b and a_b would be one."""
    unique = list[str]()
    for name in names:
        unique.append(find_free_name(name, unique))
    return unique

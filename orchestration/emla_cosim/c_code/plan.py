"""What components of a system as plain C consist of: their blocks, and the order of their calls."""

import keyword
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmublock import Block
from fmublock.c_equations import c_equations
from fmublock.errors import BuildError
from fmublock.symbolic import evaluate_symbolically

from ..base.errors import CommandError, join_names
from ..base.patterns import matches_pattern
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
"""Words that C reserves."""


@dataclass(frozen=True)
class CodeVariable:
    """A variable that the caller of the C code sees.

    Attributes:
        name: its name in the system.
        field: its name in C.
        part: position of the component.
        reference: its value reference.
        start: its start value.
        unit: its unit.
        description: its description.
        type: its FMI type.
        minimum: least value.
        maximum: largest value.
    """

    name: str
    field: str
    part: int
    reference: int
    start: float
    unit: str
    description: str
    type: str
    minimum: float
    maximum: float


@dataclass(frozen=True)
class CodePlan:
    """All that the C code needs.

    Attributes:
        name: prefix of everything in C.
        system: the components with their connections, as the FMU of a system has them.
        blocks: the block of each component.
        equations: the equations of each block as C, by its class.
        demands: the messages of each block's conditions, by its class.
        fields: name of each component in C.
        starts: start values of each component by value reference.
        inputs: what the caller sets in each step.
        outputs: what a step returns.
        parameters: what the caller may set before the start.
        step: time in s between two calls.
    """

    name: str
    system: ContainerPlan
    blocks: Sequence[type[Block]]
    equations: Mapping[type[Block], str]
    demands: Mapping[type[Block], Sequence[str]]
    fields: Sequence[str]
    starts: Sequence[Mapping[int, float]]
    inputs: Sequence[CodeVariable]
    outputs: Sequence[CodeVariable]
    parameters: Sequence[CodeVariable]
    step: float


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
    chosen = _choose(system, components)
    own = {c.name for c in chosen}
    inside = [x for x in system.connections if {x.ends[0][0], x.ends[1][0]} <= own]
    alone = replace(system, components=tuple(chosen), connections=tuple(inside), bonds={})
    blocks = [_block_of(c) for c in chosen]
    plan = plan_container(alone, {n: fmus[n] for n in own}, _restrict(algorithm, own), times)
    multiple = _check(plan)
    fields = _fields([c.name for c in chosen])
    by_name = dict(zip([c.name for c in chosen], zip(blocks, fields, strict=True), strict=True))
    ordered = [by_name[part.name] for part in plan.parts]
    blocks, fields = [b for b, _ in ordered], [f for _, f in ordered]
    try:
        symbols = {block: evaluate_symbolically(block()) for block in dict.fromkeys(blocks)}
    except BuildError as error:
        raise CommandError(str(error)) from error
    starts = [_starts(plan, p) for p in range(len(plan.parts))]
    seen = _Variables(plan, blocks, fields, starts)
    driving = {
        ".".join(x.ends[0]) for x in system.connections if x.ends[0][0] in own and x.ends[1][0] not in own
    }
    return CodePlan(
        name=name,
        system=plan,
        blocks=blocks,
        equations={block: c_equations(block(), symbolic) for block, symbolic in symbols.items()},
        demands={block: symbolic.demands for block, symbolic in symbols.items()},
        fields=fields,
        starts=starts,
        inputs=seen.open_inputs(),
        outputs=seen.outputs(outputs, driving),
        parameters=seen.parameters(),
        step=times.clock.point(multiple) - times.clock.point(0),
    )


def _choose(system: System, patterns: Collection[str]) -> list[Component]:
    if not patterns:
        names = join_names([c.name for c in system.components])
        raise CommandError(f"plain C needs --components, such as --components controller; there are {names}.")
    found = set[str]()
    for pattern in patterns:
        names = [
            c.name
            for c in system.components
            if matches_pattern(c.name, pattern) or matches_pattern(c.name, f"*.{pattern}")
        ]
        if not names:
            there = join_names([c.name for c in system.components])
            raise CommandError(
                f"no component matches '{pattern}' of --components; there are {there}.", name=pattern
            )
        found.update(names)
    return [c for c in system.components if c.name in found]


def _block_of(component: Component) -> type[Block]:
    """Return the block of a component; CommandError if it is no block, or one that reads data."""
    if not component.model:
        raise CommandError(f"{component.name} is an FMU file; only blocks of Python can be plain C.")
    block = find_block(component.model) if isinstance(component.model, str) else component.model
    return block if isinstance(block, type) else type(block)


def _restrict(algorithm: Algorithm, own: Collection[str]) -> Algorithm:
    """Return the algorithm for some of the components."""
    changes: dict[str, Any] = {}
    if order := getattr(algorithm, "order", None):
        changes["order"] = [n for n in order if n in own]
    if multiples := getattr(algorithm, "step_multiples", None):
        changes["step_multiples"] = {n: m for n, m in multiples.items() if n in own}
    return replace(algorithm, **changes) if changes else algorithm


def _check(plan: ContainerPlan) -> int:
    """Return the common step multiple; CommandError if the components cannot be plain C."""
    if plan.groups:
        raise CommandError("plain C has no strong coupling; add --algorithm gauss-seidel.")
    if any(part.mode for part in plan.parts):
        raise CommandError("plain C does not extrapolate inputs; add --extrapolation none.")
    if loops := [g for g in plan.initial_groups if len(g.coupling)]:
        names = join_names([plan.parts[i].name for i in loops[0].members])
        raise CommandError(f"the initial values of {names} depend on each other; plain C cannot solve them.")
    multiples = {part.multiple for part in plan.parts}
    if len(multiples) > 1:
        steps = ", ".join(f"{part.name} {part.multiple}" for part in plan.parts)
        raise CommandError(f"the components have different step multiples: {steps}; export each rate alone.")
    if others := [library.file.path for library in plan.libraries if library.source != "fmi2_block.c"]:
        raise CommandError(f"the FMU '{others[0]}' has data or other code; only equations can be plain C.")
    return multiples.pop()


def _starts(plan: ContainerPlan, p: int) -> dict[int, float]:
    part = plan.parts[p]
    found = {
        int(v.valueReference): v.start for v in part.instance.file.variables.values() if v.start is not None
    }
    found |= {int(v.valueReference): value for v, value in part.starts}
    return {r: _number(value) for r, value in found.items()}


def _number(value: Any) -> float:
    return float({"true": 1.0, "false": 0.0}.get(value, value)) if isinstance(value, str) else float(value)


def _fields(names: Sequence[str]) -> list[str]:
    """Return names of components in C: without their joint if they all have the same one."""
    joints = {name.partition(".")[0] for name in names if "." in name}
    shared = len(joints) == 1 and all("." in name for name in names)
    return _make_unique([as_identifier(name.partition(".")[2] if shared else name) for name in names])


def as_identifier(name: str) -> str:
    """Return a name in C: `x[1]` is `x_1`."""
    plain = re.sub(r"\W+", "_", name.rstrip("]"), flags=re.ASCII).strip("_")
    plain = plain if re.match(r"[A-Za-z_]", plain) else f"_{plain}"
    return f"{plain}_" if plain in _WORDS or keyword.iskeyword(plain) else plain


class _Variables:
    """The variables that the caller sees."""

    def __init__(
        self,
        plan: ContainerPlan,
        blocks: Sequence[type[Block]],
        fields: Sequence[str],
        starts: Sequence[Mapping[int, float]],
    ) -> None:
        self._plan, self._fields, self._starts = plan, fields, starts
        self._layouts = [block().layout() for block in blocks]

    def open_inputs(self) -> list[CodeVariable]:
        """Return the inputs that no chosen component drives."""
        found = list[CodeVariable]()
        for p, layout in enumerate(self._layouts):
            driven = {v.name for v in self._plan.parts[p].instance.read}
            references = layout.references(layout.inputs)
            found += [self._variable(p, r) for r in references if layout.scalars[r].name not in driven]
        return _unique(found)

    def outputs(self, patterns: Collection[str], driving: Collection[str]) -> list[CodeVariable]:
        """Return the chosen outputs, else those that drive others, else all."""
        every = [
            self._variable(p, r)
            for p, layout in enumerate(self._layouts)
            for r in layout.references(layout.outputs)
        ]
        for pattern in patterns:
            if not any(matches_pattern(v.name, pattern) for v in every):
                raise CommandError(
                    f"no output matches '{pattern}'; there are {join_names([v.name for v in every])}."
                )
        if patterns:
            return _unique([v for v in every if any(matches_pattern(v.name, x) for x in patterns)])
        return _unique([v for v in every if v.name in driving] or every)

    def parameters(self) -> list[CodeVariable]:
        """Return the parameters that can be set."""
        return _unique(
            [
                self._variable(p, r)
                for p, layout in enumerate(self._layouts)
                for r in layout.references(layout.parameters)
            ]
        )

    def _variable(self, p: int, reference: int) -> CodeVariable:
        scalar = self._layouts[p].scalars[reference]
        variable = scalar.variable
        low, high = variable.range
        return CodeVariable(
            name=f"{self._plan.parts[p].name}.{scalar.name}",
            field=f"{self._fields[p]}_{as_identifier(scalar.name)}",
            part=p,
            reference=reference,
            start=self._starts[p].get(reference, scalar.start),
            unit=variable.unit or "",
            description=variable.description or "",
            type=variable.fmi_type,
            minimum=float(low),
            maximum=float(high),
        )


def _unique(found: list[CodeVariable]) -> list[CodeVariable]:
    """Return the variables with fields that differ."""
    fields = _make_unique([one.field for one in found])
    return [replace(one, field=field) for one, field in zip(found, fields, strict=True)]


def _make_unique(names: Sequence[str]) -> list[str]:
    """Return names in C that differ: two names such as a.b and a_b would be one."""
    result = list[str]()
    for name in names:
        unique, number = name, 2
        while unique in result:
            unique, number = f"{name}_{number}", number + 1
        result.append(unique)
    return result


def find_initial_order(plan: ContainerPlan) -> list[int]:
    """Return the order in which components get their initial inputs."""
    return [i for group in plan.initial_groups for i in group.members]


def find_assumed_signals(plan: ContainerPlan) -> list[float]:
    """Return the signals that agree with the start values of the inputs that read them; 0 if nothing does."""
    network = plan.network
    network.signals[:] = 0.0
    for i, part in enumerate(plan.parts):
        network.instances[i].inputs[:] = part.instance.input_starts
        network.assume_inputs(i)
    return network.signals.tolist()

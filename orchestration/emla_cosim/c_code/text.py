"""Components as plain C: the header and the source.

The arithmetic is that of the FMUs, operation by operation (`fmublock/shim/equations.h`), so that numbers of
type double have the same bits.
"""

import json
import math
import re
from collections.abc import Sequence

from fmublock import Block, instance
from fmublock.compiling import c_number
from fmublock.variables import StartTime

from ..base.errors import CommandError
from ..master.algorithms.program import Call
from .plan import CodePlan, CodeVariable, find_assumed_signals, find_initial_order

MARK = "/* Written by EMLA-Cosim:"
"""Begin of both files, by which they are recognized."""

DOUBLE, FLOAT = PRECISIONS = ("double", "float")
"""Types of all numbers."""

_LARGEST_WHOLE = 2**24
"""Largest whole number below which float has all whole numbers."""

_NUMBER = re.compile(r"(?<![\w.])(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|(?<![\w.])\d+[eE][-+]?\d+")


def header_text(plan: CodePlan, precision: str) -> str:
    """Return the header."""
    name, guard = plan.name, f"{plan.name.upper()}_H"
    lines = [
        f"{MARK} {_comment(', '.join(part.name for part in plan.system.parts))}.",
        " *",
        f" * Call {name}_defaults once for the default parameters and inputs, {name}_start before the",
        f" * first step, and {name}_step every {c_number(plan.step)} s. Nothing allocates memory. Several",
        " * instances are independent.",
        " */",
        "",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f"#define {name.upper()}_STEP {_literal(plan.step, precision)} /* s between calls of {name}_step */",
        "",
        f"typedef {precision} {name}_real;",
        "",
    ]
    for kind, listed in (("parameters", plan.parameters), ("inputs", plan.inputs), ("outputs", plan.outputs)):
        lines += _struct(f"{name}_{kind}", f"{name}_real", listed)
    lines += ["/* The memory of an instance: not for callers. */", f"typedef struct {name} {{"]
    lines += ["    unsigned long count;"]
    lines += [f"    {name}_real start_time, signals[{_room(len(plan.system.network.signals))}];"]
    for field, block in zip(plan.fields, plan.blocks, strict=True):
        lines += [
            f"    {name}_real values_{field}[{_room(len(block().layout().scalars))}], "
            f"fixed_{field}[{_room(_count_fixed(plan, block))}];"
        ]
    lines += [
        f"}} {name};",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        "/* Set all parameters and inputs to their defaults. */",
        f"void {name}_defaults({name}_parameters *parameters, {name}_inputs *inputs);",
        "",
        "/* Start at a time in s with these inputs. Returns NULL, or which parameter is wrong. */",
        f"const char *{name}_start({name} *memory, {name}_real time, const {name}_parameters *parameters,",
        f"                         const {name}_inputs *inputs, {name}_outputs *outputs);",
        "",
        "/* Do one step with these inputs. Returns 1, or 0 if a result is not finite: then start again. */",
        f"int {name}_step({name} *memory, const {name}_inputs *inputs, {name}_outputs *outputs);",
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def source_text(plan: CodePlan, precision: str) -> str:
    """Return the source.

    Raises:
        CommandError: The equations contain large whole numbers, as random numbers do, and float is asked for.
    """
    name = plan.name
    lines = [
        f"{MARK} {_comment(', '.join(part.name for part in plan.system.parts))}. */",
        "",
        "#include <stddef.h>",
        "#include <tgmath.h>",
        "",
        f'#include "{name}.h"',
        "",
    ]
    helpers, functions = "", list[str]()
    for block in plan.equations:
        helpers, own = _block_text(plan, block)
        functions.append(own)
    numeric = "\n".join([*_used(helpers, functions), *functions])
    if precision == FLOAT:
        _check_float(plan, numeric)
    lines += [_typed(numeric, name, precision), *_exchange(plan, precision), *_calls(plan, precision)]
    return "\n".join(lines)


def _used(helpers: str, functions: Sequence[str]) -> list[str]:
    """Return the lines of the common functions that are called."""
    text, lines = "\n".join(functions), helpers.splitlines()
    called = [x for x in lines if (own := re.match(r"static inline \w+ (\w+)\(", x)) and f"{own[1]}(" in text]
    return [*lines[:1], *called, ""] if called else []


def _prefix(plan: CodePlan, block: type[Block]) -> str:
    """Return what begins the names of a block's functions; blocks of several files may have one name."""
    same = [other for other in plan.equations if other.__name__ == block.__name__]
    number = same.index(block)
    return f"{block.__name__}{number + 1}_" if number else f"{block.__name__}_"


def _struct(name: str, real: str, variables: Sequence[CodeVariable]) -> list[str]:
    rows = []
    for one in variables:
        unit = (
            f" / ({one.unit})"
            if one.unit and re.search(r"[./]", one.unit)
            else f" / {one.unit}"
            if one.unit
            else ""
        )
        text = f"{one.name}{unit}" + (f": {one.description}" if one.description else "")
        rows.append(f"    {real} {one.field}; /* {_comment(text)} */")
    return [
        f"typedef struct {name} {{",
        *(rows or [f"    {real} none; /* there is none */"]),
        f"}} {name};",
        "",
    ]


def _block_text(plan: CodePlan, block: type[Block]) -> tuple[str, str]:
    """Return the common functions, and those of a block with its name before theirs."""
    text = plan.equations[block]
    parts = re.split(r"(?m)^(?=static void )", text)
    constants = {n: int(x) for n, x in re.findall(r"#define (N_\w+) (\d+)", parts[0])}
    helpers = parts[0].split("\n\n", 1)[1]
    prefix = _prefix(plan, block)
    unused = "" if block().layout().states else "|derivatives|stepwise_values"
    kept = [
        re.sub(r"^static void ", f"static void {prefix}", part)
        for part in parts[1:]
        if not re.match(rf"static void (\w+_tangent{unused})\(", part)
    ]
    return helpers, "\n".join(
        [f"/* ---- {block.__name__} ---- */\n", *kept, _advance(block, prefix, constants)]
    )


def _count_fixed(plan: CodePlan, block: type[Block]) -> int:
    found = re.search(r"#define N_FIXED (\d+)", plan.equations[block])
    assert found is not None
    return int(found[1])


def _advance(block: type[Block], prefix: str, constants: dict[str, int]) -> str:
    """Return the function that does a step of a block: states by Runge-Kutta, then discrete states."""
    layout = block().layout()
    states, discrete = layout.references(layout.states), layout.references(layout.discrete_states)
    outputs = layout.references(layout.outputs)
    stepwise = _room(constants["N_STEPWISE"])
    lines = [
        f"static void {prefix}advance(double *v, const double *fixed, double time, double step,",
        "                             double end) {",
    ]
    if len(states):
        n, first = len(states), states[0]
        internal = layout.references((block.internal_step,))[0]
        lines += [
            f"    double *x = v + {first}, x0[{n}], k1[{n}], k2[{n}], k3[{n}], k4[{n}];",
            f"    double stepwise[{stepwise}];",
            f"    double count = ceil(step / v[{internal}] - {c_number(instance.SAME_COUNT)});",
            "    if (!(count >= 1.0)) count = 1.0;",
            "    const double dt = step / count;",
            f"    {prefix}stepwise_values(v, fixed, stepwise);",
            "    for (long i = 0; i < (long)count; i++) {",
            "        const double t = time + (double)i * dt;",
            f"        for (int j = 0; j < {n}; j++) x0[j] = x[j];",
            f"        {prefix}derivatives(t, v, fixed, stepwise, k1);",
            f"        for (int j = 0; j < {n}; j++) x[j] = x0[j] + 0.5 * dt * k1[j];",
            f"        {prefix}derivatives(t + 0.5 * dt, v, fixed, stepwise, k2);",
            f"        for (int j = 0; j < {n}; j++) x[j] = x0[j] + 0.5 * dt * k2[j];",
            f"        {prefix}derivatives(t + 0.5 * dt, v, fixed, stepwise, k3);",
            f"        for (int j = 0; j < {n}; j++) x[j] = x0[j] + dt * k3[j];",
            f"        {prefix}derivatives(t + dt, v, fixed, stepwise, k4);",
            f"        for (int j = 0; j < {n}; j++) k1[j] = k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j];",
            f"        for (int j = 0; j < {n}; j++) x[j] = x0[j] + dt / 6.0 * k1[j];",
            "    }",
        ]
    else:
        lines.append("    (void)time, (void)step;")
    lines += [
        f"    double next[{_room(len(discrete))}];",
        f"    {prefix}update_and_outputs(end, v, fixed, next, v + {outputs[0] if len(outputs) else 0});",
    ]
    if len(discrete):
        lines.append(f"    for (int j = 0; j < {len(discrete)}; j++) v[{discrete[0]} + j] = next[j];")
    return "\n".join([*lines, "}", ""])


def _exchange(plan: CodePlan, precision: str) -> list[str]:
    """Return the functions that pass values between the components."""
    network, name = plan.system.network, plan.name
    lines = list[str]()
    for i, (part, field) in enumerate(zip(plan.system.parts, plan.fields, strict=True)):
        lines += [f"static void set_inputs_of_{field}({name} *m) {{", "    (void)m;"]
        for j, own in enumerate(part.instance.read):
            factor, offset = float(network.factors[i][j]), float(network.offsets[i][j])
            value = f"m->signals[{int(network.sources[i][j])}]"
            value = value if factor == 1.0 else f"{_literal(factor, precision)} * {value}"
            value = value if offset == 0.0 else f"{value} + {_literal(offset, precision)}"
            if own.type == "Boolean":
                value = f"rint({value}) != 0"
            elif own.type != "Real":
                value = f"rint({value})"
            lines.append(
                f"    m->values_{field}[{own.valueReference}] = {value}; "
                f"/* {_comment(part.name)}.{_comment(own.name)} */"
            )
        lines += ["}", "", f"static void get_outputs_of_{field}({name} *m) {{", "    (void)m;"]
        first = network.parts[i].start
        for s, own in enumerate(part.instance.written, first):
            lines.append(f"    m->signals[{s}] = m->values_{field}[{own.valueReference}];")
        lines += ["}", ""]
    for kind, listed in (("inputs", plan.inputs), ("outputs", plan.outputs)):
        const = "const " if kind == "inputs" else ""
        lines += [
            f"static void pass_{kind}({name} *m, {const}{name}_{kind} *given) {{",
            "    (void)m, (void)given;",
        ]
        for one in listed:
            here, there = f"m->values_{plan.fields[one.part]}[{one.reference}]", f"given->{one.field}"
            lines.append(f"    {here} = {there};" if kind == "inputs" else f"    {there} = {here};")
        lines += ["}", ""]
    return lines


def _calls(plan: CodePlan, precision: str) -> list[str]:
    """Return the functions for callers."""
    name, parts = plan.name, list(zip(plan.fields, plan.blocks, strict=True))
    lines = [
        f"void {name}_defaults({name}_parameters *parameters, {name}_inputs *inputs) {{",
        "    (void)parameters, (void)inputs;",
    ]
    for kind, listed in (("parameters", plan.parameters), ("inputs", plan.inputs)):
        lines += [f"    {kind}->{one.field} = {_literal(one.start, precision)};" for one in listed]
    lines += [
        "}",
        "",
        f"static const char *set_parameters({name} *m, const {name}_parameters *p) {{",
        "    (void)m, (void)p;",
    ]
    for one in plan.parameters:
        lines.append(f"    if (!({_condition(one, precision)})) return {_text(_demand(one))};")
    lines += [
        f"    m->values_{plan.fields[one.part]}[{one.reference}] = p->{one.field};" for one in plan.parameters
    ]
    lines += ["    return NULL;", "}", ""]
    lines += [
        f"static int is_finite(const {name} *m) {{",
        *(f"    for (int r = {a}; r < {b}; r++)\n        if (!isfinite(m->values_{field}[r])) return 0;"
          for field, block in parts if (span := _evolving(block)) for a, b in [span]),
        "    return 1;",
        "}",
        "",
    ]  # fmt: skip
    lines += [
        f"const char *{name}_start({name} *memory, {name}_real time, const {name}_parameters *parameters,",
        f"                         const {name}_inputs *inputs, {name}_outputs *outputs) {{",
        f"    {name} *m = memory;",
        "    m->start_time = time;",
        "    m->count = 0;",
    ]
    for p, (field, block) in enumerate(parts):
        layout = block().layout()
        for r, scalar in enumerate(layout.scalars):
            start = plan.starts[p].get(r, scalar.start)
            lines.append(
                f"    m->values_{field}[{r}] = {_literal(start, precision)}; /* {_comment(scalar.name)} */"
            )
    lines += [
        "    const char *wrong = set_parameters(m, parameters);",
        "    if (wrong != NULL) return wrong;",
    ]
    for field, block in parts:
        layout = block().layout()
        for r in (*layout.references(layout.states), *layout.references(layout.discrete_states)):
            if layout.scalars[r].variable.start_parameter is not None:
                lines.append(f"    m->values_{field}[{r}] = m->values_{field}[{layout.start_reference(r)}];")
            if isinstance(layout.scalars[r].variable, StartTime):
                lines.append(f"    m->values_{field}[{r}] = time;")
        lines.append(f"    {_prefix(plan, block)}fixed_values(m->values_{field}, m->fixed_{field});")
    for field, block in parts:
        lines += _conditions(plan, field, block)
    lines.append("    pass_inputs(m, inputs);")
    for s, value in enumerate(find_assumed_signals(plan.system)):
        lines.append(f"    m->signals[{s}] = {_literal(value, precision)};")
    for i in [*find_initial_order(plan.system), *range(len(parts))]:
        lines += [f"    set_inputs_of_{parts[i][0]}(m);", *_outputs_call(plan, *parts[i])]
    lines += [f"    get_outputs_of_{field}(m);" for field, _ in parts]
    lines += [f"    set_inputs_of_{parts[i][0]}(m);" for i in plan.system.network.order]
    lines += [
        "    pass_outputs(m, outputs);",
        '    return is_finite(m) ? NULL : "an initial value is not finite.";',
        "}",
        "",
    ]
    lines += [
        f"int {name}_step({name} *memory, const {name}_inputs *inputs, {name}_outputs *outputs) {{",
        f"    {name} *m = memory;",
        f"    const {name}_real step = {_literal(plan.step, precision)};",
        f"    const {name}_real time = m->start_time + ({name}_real)m->count * step;",
        "    m->count += 1;",
        f"    const {name}_real end = m->start_time + ({name}_real)m->count * step;",
        "    pass_inputs(m, inputs);",
    ]
    for operation in plan.system.operations:
        field, block = parts[operation.instance]
        if operation.call == Call.STEP:
            lines.append(
                f"    {_prefix(plan, block)}advance(m->values_{field}, m->fixed_{field}, time, step, end);"
            )
        else:
            call = "set_inputs_of" if operation.call == Call.SET else "get_outputs_of"
            lines.append(f"    {call}_{field}(m);")
    lines += ["    pass_outputs(m, outputs);", "    return is_finite(m);", "}", ""]
    return lines


def _condition(one: CodeVariable, precision: str) -> str:
    """Return when a parameter can be used, in C."""
    value = f"p->{one.field}"
    found = [f"{value} == {value if one.type == 'Real' else f'rint({value})'}"]
    if one.minimum > -math.inf:
        found.append(f"{_literal(one.minimum, precision)} <= {value}")
    if one.maximum < math.inf:
        found.append(f"{value} <= {_literal(one.maximum, precision)}")
    return " && ".join(found)


def _demand(one: CodeVariable) -> str:
    whole = "" if one.type == "Real" else " or is no whole number"
    return f"{one.name} is outside of its range, {one.minimum:.9g} to {one.maximum:.9g}{whole}."


def _evolving(block: type[Block]) -> tuple[int, int] | None:
    """Return the range of value references of states and outputs; None if there is none."""
    layout = block().layout()
    first = len(layout.references(layout.inputs)) + len(layout.references(layout.parameters))
    return (first, len(layout.scalars)) if first < len(layout.scalars) else None


def _outputs_call(plan: CodePlan, field: str, block: type[Block]) -> list[str]:
    layout = block().layout()
    outputs = layout.references(layout.outputs)
    if not len(outputs):
        return []
    return [
        f"    {_prefix(plan, block)}outputs(time, m->values_{field}, m->fixed_{field}, "
        f"m->values_{field} + {outputs[0]});",
        f"    get_outputs_of_{field}(m);",
    ]


def _conditions(plan: CodePlan, field: str, block: type[Block]) -> list[str]:
    demands = plan.demands[block]
    if not demands:
        return []
    lines = [
        "    {",
        f"        {plan.name}_real holds[{len(demands)}];",
        f"        {_prefix(plan, block)}conditions(time, m->values_{field}, m->fixed_{field}, holds);",
    ]
    lines += [
        f"        if (holds[{i}] == 0) return {_text(f'{field}: {message}')};"
        for i, message in enumerate(demands)
    ]
    return [*lines, "    }"]


def _check_float(plan: CodePlan, text: str) -> None:
    large = [
        x for x in map(float, _NUMBER.findall(text)) if x == int(x) and abs(x) > _LARGEST_WHOLE and x < 1e15
    ]
    if large:
        raise CommandError(
            f"the equations of {plan.name} contain the whole number {large[0]:.0f}, as random numbers do; "
            "float has them only up to 16777216. Use --precision double."
        )


def _typed(text: str, name: str, precision: str) -> str:
    """Return C with numbers of the type that the header defines."""
    typed = re.sub(r"\bdouble\b", f"{name}_real", text)
    return typed if precision == DOUBLE else _NUMBER.sub(lambda m: f"{m[0]}f", typed)


def _literal(value: float, precision: str) -> str:
    text = c_number(value)
    return text if precision == DOUBLE or not _NUMBER.search(text) else f"{text}f"


def _room(count: int) -> int:
    return max(count, 1)


def _comment(text: str) -> str:
    """Return a text that does not end a comment, in ASCII."""
    plain = text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ")
    return plain.encode("ascii", "backslashreplace").decode()


def _text(text: str) -> str:
    return json.dumps(text)

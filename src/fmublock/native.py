"""Native FMUs: the block's equations as C inside a generic shim for FMI 2.0 or 3.0, compiled by zig."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from .block import Block
from .c_equations import c_equations
from .compiling import c_number, c_text, compile_libraries, constants, rename_folders, sources
from .description import FmuFeatures, find_structure, offers_model_exchange
from .export import Draft, draft
from .fmi3_description import build_description, element_counts, time_reference, time_variable
from .recipe import Documents, Producer
from .symbolic import SymbolicBlock, evaluate_symbolically
from .variables import Access, StartTime


def _get_main_file(fmi: int) -> str:
    """Return the only file to compile; it includes all others."""
    return f"fmi{fmi}_block.c"


def native_draft(
    block: Block,
    producer: Producer,
    documents: Documents,
    has_sources: bool = True,
    fmi: int = 2,
    clock: float | None = None,
) -> Draft:
    """Return the FMU without binaries: description, documents and C sources.

    Without sources these are only for the compiler.

    Raises:
        BuildError: The equations fail, or would give different results in C and in Python.
    """
    symbolic = evaluate_symbolically(block)
    content = {
        "sources/generated.h": c_equations(block, symbolic).text().encode(),
        "sources/model.h": _format_model_header(block, symbolic, fmi, clock).encode(),
        **sources("shim", fmi),
    }
    if fmi == 3:
        content["sources/buildDescription.xml"] = build_description(
            type(block).__name__, [_get_main_file(fmi)]
        )
    offers = FmuFeatures(
        derivatives=True,
        model_exchange=offers_model_exchange(block) and clock is None,
        source_files=(_get_main_file(fmi),) if has_sources else (),
        clock=clock,
    )
    # the GUID is the hash of all files, so that the file that contains it is added afterwards
    anonymous = draft(block, symbolic, producer, documents, content, offers, has_sources, fmi)
    guid_header = {"sources/guid.h": f'#define MODEL_GUID "{anonymous.guid}"\n'.encode()}
    return replace(anonymous, files={**anonymous.files, **guid_header})


def native_binaries(
    draft: Draft, platforms: Sequence[str], advance: Callable[[], None] = lambda: None
) -> dict[str, bytes]:
    """Return the binaries for these FMI platforms, by path; `advance` is called after each.

    Raises:
        BuildError: The compiler fails, or a platform is not supported.
    """
    libraries = compile_libraries(
        type(draft.block).__name__, [_get_main_file(draft.fmi)], draft.files, platforms, advance
    )
    return rename_folders(libraries, draft.fmi)


def _format_model_header(block: Block, symbolic: SymbolicBlock, fmi: int, clock: float | None) -> str:
    """Return names, types, ranges, start and nominal values as C: all that the shim knows of the block."""
    layout = block.layout()
    name = type(block).__name__
    lines = [
        f'#define MODEL_IDENTIFIER "{name}"',
        f"#define N_INPUTS {len(layout.references(layout.inputs))}",
        f"#define N_PARAMETERS {len(layout.references(layout.parameters))}",
        f"#define N_STATES {len(layout.references(layout.states))}",
        f"#define N_DISCRETE_STATES {len(layout.references(layout.discrete_states))}",
        f"#define N_OUTPUTS {len(layout.references(layout.outputs))}",
    ]
    lines += constants()
    counts: list[int] = element_counts(block) if fmi == 3 else []
    if all(count == 1 for count in counts):
        counts = []  # then the compiler removes what only arrays need
    else:
        # only for blocks that have some: the check costs time for each variable that a host reads
        lines.append("#define HAS_ARRAYS")
    types = "/* type: R Real, I Integer or enumeration, B Boolean;"
    letters = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B"}
    if fmi == 3:
        types = "/* type: R Float64, I Int32, E Enumeration, B Boolean;"
        # FMI 3.0 exchanges enumerations as Int64
        letters["Enumeration"] = "E"
    if clock is not None:
        lines.append(f"#define CLOCK_INTERVAL {c_number(clock)}")
    elif offers_model_exchange(block):
        lines.append("#define MODEL_EXCHANGE")
    if layout.states:
        lines.append(f"#define INTERNAL_STEP {layout.references((type(block).internal_step,))[0]}")
    lines += [
        "",
        types,
        " * access: S settable, F fixed, H hidden;",
        *(
            [" * elements: number of values of the variable that begins here; 0 inside of an array;"]
            if counts
            else []
        ),
        " * start_reference: the parameter that a state starts from, -1, or -2 for the start time */",
        "typedef struct {",
        "    const char *name;",
        "    char type, access;",
        *(["    int elements;"] if counts else []),
        "    double start, minimum, maximum, nominal;",
        "    int start_reference;",
        "} Variable;",
        "",
        "static const Variable variables[] = {",
    ]
    for reference, scalar in enumerate((*layout.scalars, *layout.derivatives)):
        variable = scalar.variable
        start_reference = -2 if isinstance(variable, StartTime) else -1
        if variable.start_parameter is not None:
            start_reference = layout.start_reference(reference)
        nominal = 1.0 if variable.nominal is None else variable.nominal
        values = ", ".join(c_number(x) for x in (scalar.start, *variable.range, nominal))
        letter = letters[variable.fmi_type] if not counts or counts[reference] else " "  # inside of an array
        access = f"'{scalar.access.value}'" + (f", {counts[reference]}" if counts else "")
        # a hidden name must not be in the binary either
        name = "" if scalar.access is Access.HIDDEN else scalar.name
        lines.append(f"    {{\"{name}\", '{letter}', {access}, {values}, {start_reference}}},")
    tables = _format_limits(block) + _format_conditions(symbolic.demands)
    if fmi == 3:
        time = time_variable(block).name
        elements = ", 1" if counts else ""
        lines.append(f"    {{\"{time}\", 'R', 'S'{elements}, 0.0, -HUGE_VAL, HUGE_VAL, 1.0, -1}},")
        tables += _format_dependencies(block, symbolic)
    return "\n".join([*lines, "};", *tables, ""])


def _format_dependencies(block: Block, symbolic: SymbolicBlock) -> list[str]:
    """Return on which others values depend, as C."""
    structure = find_structure(block, symbolic, True, time_reference(block))
    unknowns = sorted({**structure.outputs, **structure.derivatives}.items())
    rows = [
        f"    {{{unknown}, {reference}}}," for unknown, knowns in unknowns for reference in sorted(knowns)
    ]
    return [
        "",
        f"#define N_DEPENDENCIES {len(rows)}",
        "static const struct {",
        "    int unknown, known;",
        "} dependencies[] = {",
        # C has no empty arrays
        *(rows or ["    {-1, -1},"]),
        "};",
    ]


def _format_conditions(demands: Sequence[str]) -> list[str]:
    """Return the messages of the block's conditions as C, in the order of their values."""
    rows = [f"    {c_text(message)}," for message in demands]
    table = ["static const char *const demands[] = {", *rows, "};"] if rows else []
    return ["", f"#define N_CONDITIONS {len(rows)}", *table]


def _format_limits(block: Block) -> list[str]:
    """Return the variables with limits as C, and the parameters that are these limits."""
    layout = block.layout()
    references = ((r, layout.limit_references(r)) for r in range(len(layout.scalars)))
    rows = [
        f"    {{{r}, {low}, {high}}}," for r, (low, high) in ((r, x) for r, x in references if x is not None)
    ]
    return [
        "",
        f"#define N_LIMITS {len(rows)}",
        "/* low and high: the parameters that limit a variable; one parameter for both directions */",
        "static const struct {",
        "    int variable, low, high;",
        "} limits[] = {",
        *(rows or ["    {-1, -1, -1},"]),
        "};",
    ]

"""Build the FMU of a table of numbers; nothing is compiled for the data."""

import hashlib
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from ..archive import content_guid, write_archive
from ..cache import find_built
from ..compiling import compile_libraries, constants, rename_folders, sources
from ..documentation import html_page
from ..errors import BuildError
from ..files import write_atomically
from ..fmi3_description import build_description
from ..platforms import TARGETS, host_platform
from ..recipe import Producer, describe_producer
from .content import MODEL, SPANS, TableColumn, TableContent, TableOutput, pack_table
from .description import table_description

_MAINS = {2: "fmi2_table.c", 3: "fmi3_table.c"}
"""The C file to compile, by version of FMI."""

_CAPACITIES = (16, 256, 1024)
"""Most outputs of each library; the smallest that suffices is used."""

MOST_OUTPUTS = _CAPACITIES[-1]

_PAGE = """# Data over time

The outputs are the values of a table of measured or computed data at the communication points.
The numbers are in `resources/table.bin`. `sources/data.h` and `sources/resource.h` describe this file.

{rows} rows from t = {first:.9g} s to t = {last:.9g} s. Before the first row its values hold.
After the last row: {end}.

| Output | Unit | Between rows | |
|---|---|---|---|
{outputs}
"""
_LICENSE_HEADER = "Of the program in sources/ and binaries/, not of the data:\n\n"
_ENDS = {
    "hold": "its values hold",
    "repeat": "the first row again, which replaces the last one",
    "stop": "steps are discarded, and the FMU asks to end the run",
}
_ORDERS = ("", "its derivative", "its second derivative")


def build_table(
    table: TableContent,
    path: Path,
    platforms: Sequence[str] = (),
    producer: Producer | None = None,
    license_text: str | None = None,
) -> Path:
    """Write the FMU of a table and return its file. Its bytes depend on content and platforms only.

    Args:
        table: Columns and outputs, at most `MOST_OUTPUTS` of these.
        path: The file to write.
        platforms: FMI platforms. Default: this machine's. Their libraries are compiled once and cached.
        producer: The tool that the FMU names.
        license_text: Licence of the data.

    Raises:
        BuildError: There are too many outputs, a library cannot be compiled, or the file cannot be written.
    """
    producer = producer or Producer()
    main = _MAINS[table.fmi]
    content = {
        **_gather_sources(table),
        "documentation/index.html": html_page(_format_page(table), MODEL).encode(),
    }
    if license_text is not None:
        content["documentation/licenses/license.txt"] = (_LICENSE_HEADER + license_text).encode()
    anonymous = table_description(table, MODEL, main, producer, "")
    # packed twice: the data contain the GUID, which is the hash of the data without it
    numbers = {"resources/table.bin": pack_table(table, "")}
    guid = content_guid({**content, **numbers, "modelDescription.xml": anonymous})
    numbers = {"resources/table.bin": pack_table(table, guid)}
    content["modelDescription.xml"] = table_description(table, MODEL, main, producer, guid)
    try:
        content |= _provide_libraries(content, platforms or (host_platform(),), table.fmi)
        write_archive(path, {**content, **numbers}, stored=numbers)
    except OSError as error:
        raise BuildError(f"the FMU '{path}' cannot be written: {error.strerror or error}.") from error
    return path


def prebuild_libraries(platforms: Sequence[str]) -> list[Path]:
    """Compile the libraries of tables with outputs of every type into the cache, and return their paths.

    Args:
        platforms: FMI platforms.

    Raises:
        BuildError: A library cannot be compiled.
    """
    times, paths = np.array([0.0, 1.0]), []
    for type_, capacity in (*(("Real", n) for n in _CAPACITIES), ("Integer", 16), ("Boolean", 16)):
        outputs = [TableOutput(f"y{i}", 0, type=type_) for i in range(capacity)]
        table = TableContent(times, [TableColumn(times, "held" if type_ != "Real" else "linear")], outputs)
        content = _gather_sources(table)
        _provide_libraries(content, platforms, table.fmi)
        paths += [_find_cached(content, platform) for platform in platforms]
    return paths


def _gather_sources(table: TableContent) -> dict[str, bytes]:
    outputs = len(table.outputs)
    capacity = next((n for n in _CAPACITIES if n >= outputs), None)
    if capacity is None:
        raise BuildError(f"a table can have {MOST_OUTPUTS} outputs, not {outputs}.")
    shared = {n: text for n, text in sources("shim", table.fmi).items() if n.endswith(".h")}
    if table.fmi == 3:
        shared["sources/buildDescription.xml"] = build_description(MODEL, [_MAINS[3]])
    header = _format_model_header(capacity, table).encode()
    return {**shared, **sources("table", table.fmi), "sources/model.h": header}


def _format_model_header(capacity: int, table: TableContent) -> str:
    """Return the header that describes the model to the shim: outputs of one type only."""
    counts = ("INPUTS", "PARAMETERS", "STATES", "CONDITIONS", "LIMITS")
    lines = [f'#define MODEL_IDENTIFIER "{MODEL}"', *(f"#define N_{name} 0" for name in counts)]
    lines += ["#define N_DISCRETE_STATES 1"]
    count = capacity * (1 + len(SPANS) if table.has_spans else 1)
    lines += [f"#define N_OUTPUTS {count}", *constants(), ""]
    lines += ["typedef struct {", "    const char *name;", "    char type, access;"]
    lines += ["    double start, minimum, maximum, nominal;", "    int start_reference;", "} Variable;", ""]
    lines += ["static const Variable variables[] = {"]
    last_point = "\"last point\", 'R', 'H'" if table.fmi == 2 else "\"time\", 'R', 'F'"
    lines += [f"    {{{last_point}, 0.0, -HUGE_VAL, HUGE_VAL, 1.0, -2}}, /* STARTS_AT_START_TIME */"]
    lines += [
        f"    {{\"output {i}\", '{table.letter}', 'S', 0.0, -HUGE_VAL, HUGE_VAL, 1.0, -1}},"
        for i in range(1, count + 1)
    ]
    lines += [
        "};",
        "",
        "static const struct {",
        "    int variable, low, high;",
        "} limits[] = {{-1, -1, -1}};",
    ]
    if table.fmi == 3:
        lines += ["#define N_DEPENDENCIES 0", "static const struct {", "    int unknown, known;"]
        lines += ["} dependencies[] = {{-1, -1}};"]
    return "\n".join([*lines, ""])


def _provide_libraries(content: dict[str, bytes], platforms: Sequence[str], fmi: int) -> dict[str, bytes]:
    """Return the libraries by their path in the FMU, from the cache or compiled."""
    libraries = {}
    for platform in platforms:
        cached = _find_cached(content, platform)
        name = f"binaries/{platform}/{cached.name}"
        try:
            libraries[name] = cached.read_bytes()
        except OSError:
            # a library serves any data, so that later tables need no compiler
            libraries |= compile_libraries(MODEL, [_MAINS[fmi]], content, [platform])
            cached.parent.mkdir(parents=True, exist_ok=True)
            with write_atomically(cached) as stream:
                stream.write(libraries[name])
    return rename_folders(libraries, fmi)


def _find_cached(content: dict[str, bytes], platform: str) -> Path:
    """Return the path of a library in the wheel or the cache."""
    key = hashlib.sha256(describe_producer().encode() + content["sources/model.h"]).hexdigest()[:24]
    suffix = TARGETS[platform][1] if platform in TARGETS else ""
    return find_built("tables", key, platform, f"{MODEL}{suffix}")


def _format_page(table: TableContent) -> str:
    rows = [
        f"| `{escape(o.name)}` | {escape(o.unit.name) if o.unit is not None else ''} "
        f"| {table.columns[o.column].interpolation} | {_ORDERS[o.order]} |"
        for o in table.outputs
    ]
    first, last = float(table.times[0]), float(table.times[-1])
    return _PAGE.format(
        rows=len(table.times), first=first, last=last, end=_ENDS[table.end], outputs="\n".join(rows)
    )

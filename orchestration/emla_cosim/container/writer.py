"""Write a system as one FMU."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from fmublock.archive import content_guid, key_comment, read_built, write_archive
from fmublock.compiling import compile_libraries, is_for, rename_folders, sources
from fmublock.errors import BuildError
from fmublock.fmi3_description import build_description
from fmublock.platforms import binaries_folder, host_platform, platform_of

from ..base.errors import CommandError, RunError
from ..base.output_files import OutputFile
from ..base.progress import Progress
from ..fmu.document import TERMINALS
from ..master.algorithms.algorithm import Algorithm
from ..master.stepping.timing import CommunicationPoints
from ..stepper.library import read_native_sources
from ..system.model import System
from .c_tables import SystemTables, write_part_source
from .description import describe_container
from .page import render_page
from .plan import ContainerPlan, Library, plan_container
from .variables import ContainerVariable, list_variables, write_terminals

_SHARED = (
    *("messages.h", "logging.h", "conversions.h"),
    *("fmi2_types.h", "fmi2_status.h", "fmi3_types.h", "fmi3_values.h", "fmi3_lacking.h"),
)
"""C files that this FMU shares with those of fmublock, if they are for its version of FMI."""


def check_container(path: Path, overwrite: bool = False) -> OutputFile:
    """Return the file of an FMU, which may be written. Raises CommandError if it must not be replaced."""
    return OutputFile(
        path, "the FMU", lambda fmu: read_built(fmu).key is not None, overwrite, creates_folder=True
    )


def write_container(
    path: Path,
    name: str,
    description: str,
    system: System,
    fmus: Mapping[str, Path],
    algorithm: Algorithm,
    times: CommunicationPoints,
    inputs: Collection[str] = (),
    outputs: Collection[str] = (),
    list_default_outputs: Callable[[Collection[str]], Sequence[str]] = lambda names: [],
    platforms: Sequence[str] = (),
    fmi: int = 2,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Mapping[str, Mapping[str, Any]]:
    """Write a system as one co-simulation FMU, which steps its FMUs as the algorithm does.

    FMUs of this project are compiled in, for any platform. The libraries of others are packed into it.
    Equal content gives equal bytes.

    Args:
        path: The file.
        name: The name of the model.
        description: Its description.
        system: The system, with its start values.
        fmus: FMU file of every component.
        algorithm: The algorithm that steps it.
        times: Start, stop and step size.
        inputs: Names or patterns of the inputs, among those that nothing drives. Default: all of these.
        outputs: Names or patterns of the outputs. Default: `list_default_outputs`.
        list_default_outputs: Returns the outputs if `outputs` is empty, from the names of all signals. An
            empty list means all outputs.
        platforms: FMI platforms. Default: that of this machine.
        fmi: Version of FMI, 2 or 3. Its FMUs keep theirs.
        overwrite: Whether to replace a file that emla did not write.
        progress: Receives the progress of compiling.

    Returns:
        The start values that an FMU changed, by component; see `Assembly.list_rejected_start_values`.

    Raises:
        CommandError: The system cannot be one FMU, or the file must not be replaced.
        RunError: It cannot be initialized or compiled, or the file cannot be written.
    """
    plan, reporter = plan_container(system, fmus, algorithm, times), progress or Progress()
    required_platforms = list(platforms) or [host_platform()]
    # before compiling, which takes longest
    for library in plan.libraries:
        _check_platforms(library, required_platforms)
    variables = list_variables(plan, inputs, outputs, list_default_outputs(plan.network.names))
    # it begins the names of C functions, and names the library
    identifier = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    identifier = identifier if re.match(r"[A-Za-z_]", identifier) else f"_{identifier}"
    content, mains = _collect_content(plan, identifier, variables, required_platforms, fmi)
    content["documentation/index.html"] = render_page(plan, name, description, variables, system).encode()
    terminals = write_terminals(plan, variables)
    if terminals is not None:
        content[TERMINALS] = terminals
    source_files = mains if all(x.source for x in plan.libraries) else []
    arguments = (plan, name, identifier, description)
    try:
        # the GUID is a hash of the content, in which it cannot be itself
        anonymous = describe_container(*arguments, "", variables, source_files, fmi)
    except BuildError as error:
        raise CommandError(str(error)) from error
    guid = content_guid({**content, "modelDescription.xml": anonymous})
    content["modelDescription.xml"] = describe_container(*arguments, guid, variables, source_files, fmi)
    content["sources/guid.h"] = f'#define MODEL_GUID "{guid}"\n'.encode()
    reporter.begin("compiling", len(required_platforms))
    try:
        binaries = compile_libraries(
            identifier,
            mains,
            content,
            required_platforms,
            lambda: reporter.advance(1),
            loads=any(x.source is None for x in plan.libraries),
        )
        binaries = rename_folders(binaries, fmi)
    except BuildError as error:
        raise RunError(f"{name} could not be built: {error}") from error
    file = check_container(path, overwrite)
    with file.report_errors():
        write_archive(path, {**content, **binaries}, key_comment(guid.strip("{}")), check=file.check_again)
    return plan.changed_start_values


def _check_platforms(library: Library, platforms: Sequence[str]) -> None:
    """Raise CommandError if a library that is packed into the FMU lacks one of the platforms."""
    if library.source is not None:
        return
    have = sorted({platform_of(p.split("/")[0]) for p in library.list_files("binaries")})
    missing = [p for p in platforms if p not in have]
    if missing:
        raise CommandError(
            f"the FMU '{library.file.path}' has no library for {', '.join(missing)}, only for "
            f"{', '.join(have)}; choose other platforms."
        )


def _collect_content(
    plan: ContainerPlan,
    identifier: str,
    variables: Sequence[ContainerVariable],
    platforms: Sequence[str],
    fmi: int,
) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of the FMU by path, and the C files to compile."""
    shim = files("emla_cosim.container").joinpath("shim")
    shim_files = (f for f in shim.iterdir() if f.name.endswith((".c", ".h")))
    content = {f"sources/{f.name}": f.read_bytes() for f in shim_files if is_for(f.name, fmi)}
    content |= {f"sources/stepper/{name}": text for name, text in _read_stepper_files().items()}
    blocks = sources("shim", fmi)
    content |= {f"sources/{name}": blocks[f"sources/{name}"] for name in _SHARED if is_for(name, fmi)}
    tables = SystemTables(plan, identifier, variables, fmi)
    for name, text in {"sizes": tables.sizes, "system": tables.header, "wiring": tables.wiring}.items():
        content[f"sources/{name}.h"] = text.encode()
    mains = [f"fmi{fmi}_container.c"]
    for library in plan.libraries:
        folder = library.folder
        if library.source is not None:
            content[f"sources/{folder}.c"] = write_part_source(folder, library.source).encode()
            mains.append(f"{folder}.c")
            content |= _relocate(library, "sources", f"sources/{folder}")
        else:
            content[f"resources/{folder}/modelDescription.xml"] = library.content["modelDescription.xml"]
            for platform in platforms:
                binaries = f"binaries/{binaries_folder(platform, library.fmi)}"
                content |= _relocate(library, binaries, f"resources/{folder}/binaries/{platform}")
        content |= _relocate(library, "resources", f"resources/{folder}/resources")
        content |= _relocate(library, "documentation/licenses", f"documentation/licenses/{folder}")
    if fmi == 3 and all(x.source for x in plan.libraries):
        content["sources/buildDescription.xml"] = build_description(identifier, mains)
    return content, mains


def _read_stepper_files() -> dict[str, bytes]:
    """Return the C files of the stepper that steps need."""
    # the loop, rows and interrupts are those of the host
    available, required = read_native_sources(), ["step.h", "event_calls.h"]
    for name in required:
        included = re.findall(r'#include "(\w+\.h)"', available[name].decode())
        required += [x for x in included if x in available and x not in required]
    return {name: available[name] for name in required}


def _relocate(library: Library, folder: str, inside: str) -> dict[str, bytes]:
    """Return the files in a folder of an FMU by their path in the container."""
    return {f"{inside}/{path}": content for path, content in library.list_files(folder).items()}

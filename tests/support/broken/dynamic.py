"""FMUs that do one thing wrong when they are called: a good one, in C, with a fault."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from string import Template

from fmu_verify.settings import Settings
from tests.support.broken.broken import read_faults, write_fmu
from tests.support.hand_written_fmus import compile_library

_FOLDER = Path(__file__).parent
GUID = "{600d0000-0000-4000-8000-000000000000}"


def build_good_fmu(
    folder: Path,
    fault: str = "",
    name: str = "Good",
    total: str = "2 9",
    sources: Mapping[str, bytes] | None = None,
) -> Path:
    """Build the FMU in a folder.

    Args:
        folder: The folder.
        fault: What is wrong, as good.c names it.
        name: Name of the FMU.
        total: Declared dependencies of this output.
        sources: Its source files by name, of which the first one is listed.
    """
    listed = "".join(f'<SourceFiles><File name="{file}"/></SourceFiles>' for file in [*(sources or {})][:1])
    description = Template((_FOLDER / "good.xml").read_text(encoding="utf-8")).substitute(
        name=name,
        guid=GUID,
        total=total,
        kinds=' dependenciesKind="constant constant"' if total == "2 9" else "",
        once=str(fault == "ONLY_ONCE").lower(),
        order=2 if fault == "DERIVATIVE_ORDER" else 1,
        sources=listed,
    )
    files = {f"sources/{file}": content for file, content in (sources or {}).items()}
    return write_fmu(folder / f"{name}.fmu", description, _library(), fault, files)


@cache
def _library() -> bytes:
    """Compiled once, for all faults."""
    return compile_library(_FOLDER / "good.c", {"MODEL_GUID": f'"{GUID}"'})


DYNAMIC = read_faults(
    "good",
    lambda folder, row, name: build_good_fmu(folder, row["fault"], name, "2 9" if row["fault"] else "9"),
    {"HANG": Settings(seconds=1.5), "MEMORY": Settings(memory=100 * 2**20)},
)
"""One for each way to go wrong, in the order of the checks; those that warn or are noted come last."""

"""FMUs with C sources that use memory wrongly: those of the good one, in C, with a fault.

Their binary is that of the good one: most such faults show only in a build with sanitizers.
"""

from pathlib import Path

from tests.support.broken.broken import read_faults
from tests.support.broken.dynamic import GUID, build_good_fmu
from tests.support.hand_written_fmus import TOYS

_FOLDER = Path(__file__).parent


def build_memory_fmu(folder: Path, fault: str = "SOUND", name: str = "Memory") -> Path:
    """Build the FMU in a folder, with one fault in its sources."""
    head = f'#define MODEL_GUID "{GUID}"\n#define FAULT {fault}\n'
    files = (_FOLDER / "memory.c", _FOLDER / "good.c", TOYS / "toyfmu.h")
    sources = {file.name: file.read_bytes() for file in files}
    sources["memory.c"] = head.encode() + sources["memory.c"]
    return build_good_fmu(folder, name=name, sources=sources)


MEMORY = read_faults("memory", lambda folder, row, name: build_memory_fmu(folder, row["fault"], name))

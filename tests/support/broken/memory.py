"""FMUs with C sources that use memory wrongly: those of the good one, in C, with a fault.

Their binary is that of the good one: most such faults show only in a build with sanitizers.
"""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

from emla_cosim.verification.verdict import Verdict
from fmublock.archive import write_archive
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import DESCRIPTION, read_files

_FOLDER = Path(__file__).parent
_LISTED = '<SourceFiles><File name="memory.c"/></SourceFiles>'


@cache
def _faults() -> dict[str, int]:
    """The numbers of the faults, by name."""
    found = re.search(r"enum \{([^}]*)\}", (_FOLDER / "memory.c").read_text(encoding="utf-8"))
    assert found
    return {name.strip(): k for k, name in enumerate(found[1].split(","))}


def build_memory_fmu(folder: Path, fault: str = "SOUND", name: str = "Memory") -> Path:
    """Build the FMU in a folder, with one fault in its sources."""
    path = build_good_fmu(folder, name=name)
    content = read_files(path.read_bytes())
    text = content[DESCRIPTION].decode()
    guid = re.search(r'guid="([^"]*)"', text)
    assert guid
    described, count = re.subn(r"(<(ModelExchange|CoSimulation)\b[^>]*)/>", rf"\1>{_LISTED}</\2>", text)
    assert count == 2
    head = f'#define MODEL_GUID "{guid[1]}"\n#define FAULT {_faults()[fault]}\n'
    content[DESCRIPTION] = described.encode()
    content["sources/memory.c"] = head.encode() + (_FOLDER / "memory.c").read_bytes()
    content["sources/good.c"] = (_FOLDER / "good.c").read_bytes()
    path.unlink()
    write_archive(path, content)
    return path


def _built(fault: str, name: str) -> Callable[[Path], Path]:
    return lambda folder: build_memory_fmu(folder, fault, name)


def _fails(fault: str, check: str, what: str, verdict: Verdict = Verdict.FAILED) -> Broken:
    name = "".join(word.capitalize() for word in fault.split("_"))
    return Broken(name, what, f"sanitizer.{check}", _built(fault, name), verdict=verdict)


# fmt: off
MEMORY: list[Broken] = [
    _fails("HEAP_OVERRUN", "address", "`fmi2SetReal` writes behind allocated memory"),
    _fails("STACK_OVERRUN", "address", "`fmi2DoStep` writes behind a local array"),
    _fails("STATIC_OVERRUN", "address", "`fmi2SetReal` writes behind a static array"),
    _fails("LONG_READ", "address", "`fmi2SetReal` reads one value more than it was given"),
    _fails("USE_AFTER_FREE", "address", "`fmi2Reset` reads memory that it freed"),
    _fails("FREED_TWICE", "address", "`fmi2Reset` frees memory twice"),
    _fails("NULL_READ", "address", "`fmi2DoStep` reads through a NULL pointer"),
    _fails("BYTES_OVERRUN", "address", "`fmi2SerializeFMUstate` writes one byte too many"),
    _fails("INSTANCE_LEAK", "leaks", "`fmi2FreeInstance` leaves memory behind"),
    _fails("STATE_LEAK", "leaks", "`fmi2GetFMUstate` forgets the state that it could use again"),
    _fails("STEP_LEAK", "leaks", "each step leaves memory behind"),
    _fails("SIGNED_OVERFLOW", "undefined", "an int overflows", Verdict.WARNING),
    _fails("MISALIGNED", "undefined", "an int is written to an odd address", Verdict.WARNING),
    _fails("SHIFT", "undefined", "an int is shifted by 32 bits", Verdict.WARNING),
]
# fmt: on

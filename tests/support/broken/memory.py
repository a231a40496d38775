"""FMUs with C sources that use memory wrongly: those of the good one, in C, with a fault.

Their binary is that of the good one: most such faults show only in a build with sanitizers.
"""

import re
from functools import cache
from pathlib import Path

from fmu_verify.verdict import Verdict
from tests.support.broken.broken import Broken, name_fault
from tests.support.broken.dynamic import GUID, build_good_fmu
from tests.support.hand_written_fmus import TOYS

_FOLDER = Path(__file__).parent


@cache
def _faults() -> dict[str, int]:
    """The numbers of the faults, by name."""
    found = re.search(r"enum \{([^}]*)\}", (_FOLDER / "memory.c").read_text(encoding="utf-8"))
    assert found
    return {name.strip(): k for k, name in enumerate(found[1].split(","))}


def build_memory_fmu(folder: Path, fault: str = "SOUND", name: str = "Memory") -> Path:
    """Build the FMU in a folder, with one fault in its sources."""
    head = f'#define MODEL_GUID "{GUID}"\n#define FAULT {_faults()[fault]}\n'
    files = (_FOLDER / "memory.c", _FOLDER / "good.c", TOYS / "toyfmu.h")
    sources = {file.name: file.read_bytes() for file in files}
    sources["memory.c"] = head.encode() + sources["memory.c"]
    return build_good_fmu(folder, name=name, sources=sources)


def _fails(fault: str, check: str, what: str, verdict: Verdict = Verdict.FAILED) -> Broken:
    name = name_fault(fault)
    return Broken(
        name,
        what,
        f"sanitizer.{check}",
        lambda folder: build_memory_fmu(folder, fault, name),
        verdict=verdict,
    )


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

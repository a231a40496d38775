"""PythonFMU FMUs: the block's own Python text behind PythonFMU's FMI library.

They need a Python of the host's on the library path; what they do is readable inside the FMU.
"""

from importlib.metadata import version
from importlib.resources import as_file, files
from pathlib import Path

from .archive import content_hash
from .block import Block
from .description import Offers, Producer
from .export import BuildError, Documents, Draft, draft
from .sources import block_modules, gather_sources, move_into_package
from .symbolic import evaluate_symbolically

_HOST = """This FMU runs Python code. Its host must offer, in the process that loads the FMU,
libpython of CPython 3.11 or later with its symbols visible to shared libraries (on Linux for
hosts that are not Python themselves: LD_PRELOAD=libpython3.XX.so). No Python package is needed;
PythonFMU {pythonfmu} is inside the FMU.
"""

_SLAVE = '''"""PythonFMU slave of {block}; the equations are in {package}/{path}."""

from {package}.{module} import {block} as EquationsOf{block}
from {package}.fmublock.slave import BlockSlave, give_reference


class {block}(BlockSlave):
    """{block} as an FMI 2.0 co-simulation slave."""

    block = EquationsOf{block}
    content = "{content}"


# PythonFMU runs this text again for every instance and then releases these globals
give_reference(globals())
'''


def python_draft(block: Block, producer: Producer, documents: Documents) -> Draft:
    """The FMU without PythonFMU's binaries.

    Raises BuildError if the block imports anything beyond the standard library.
    """
    name, module = type(block).__name__, type(block).__module__
    sources = gather_sources([*block_modules(block), "fmublock.instance"])
    sources["fmublock/slave.py"] = files("fmublock").joinpath("slave.py").read_text(encoding="utf-8")
    content = content_hash({path: text.encode() for path, text in sources.items()})
    package, slave = f"{name}_{content}", f"{name}_{content}_slave"
    resources = move_into_package(sources, package)
    resources[f"{slave}.py"] = _SLAVE.format(
        block=name, module=module, package=package, path=module.replace(".", "/") + ".py", content=content
    )
    resources["slavemodule.txt"] = slave
    for file in files("pythonfmu").iterdir():
        if file.name.endswith(".py"):
            resources[f"pythonfmu/{file.name}"] = file.read_text(encoding="utf-8")
    host = _HOST.format(pythonfmu=version("pythonfmu"))
    return draft(
        block,
        evaluate_symbolically(block),
        producer,
        documents,
        {f"resources/{path}": text.encode() for path, text in resources.items()}
        | {"documentation/externalDependencies.txt": host.encode()},
        Offers(),
    )


def build_python(draft: Draft, path: Path) -> None:
    """Write the FMU with PythonFMU's binaries. Raises BuildError without them, OSError on writing."""
    name = type(draft.block).__name__
    binaries = {}
    with as_file(files("pythonfmu") / "resources" / "binaries") as folder:
        for file in sorted(folder.glob("*/*")):
            binaries[f"binaries/{file.parent.name}/{name}{file.suffix}"] = file.read_bytes()
    if not binaries:
        raise BuildError("the installed pythonfmu package has no binaries; install its wheel from PyPI.")
    draft.write(path, binaries)

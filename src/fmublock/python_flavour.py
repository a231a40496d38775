"""PythonFMU FMUs: the block's Python files with PythonFMU's FMI library.

They need the host's Python on the library path. The equations are readable inside the FMU.
"""

from importlib.metadata import distribution, version
from importlib.resources import files
from pathlib import Path

from .archive import content_hash
from .block import Block
from .description import FmuFeatures
from .errors import BuildError
from .export import Draft, draft
from .recipe import Documents, Producer
from .sources import gather_sources, module_of, move_into_package
from .symbolic import evaluate_symbolically

_HOST = """This FMU runs Python code. The process that loads the FMU needs libpython of CPython 3.11 or
later, with its symbols visible to shared libraries. On Linux, hosts that are not Python themselves
can set LD_PRELOAD=libpython3.XX.so. No Python package is needed: PythonFMU {pythonfmu} is inside
the FMU.
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
    """Return the FMU without PythonFMU's binaries.

    Raises:
        BuildError: The block imports anything beyond the standard library, has instance attributes, has
            no file, or its equations fail or would give different results in C.
    """
    name, module = type(block).__name__, module_of(type(block))
    if vars(block):
        raise BuildError(
            f"this {name} has the attributes {', '.join(vars(block))}, which would be missing in the FMU; "
            "declare them as parameters."
        )
    symbolic = evaluate_symbolically(block)
    gathered = gather_sources(type(block), "block", "instance")
    gathered.refuse_foreign()
    sources = gathered.texts
    sources["fmublock/slave.py"] = files("fmublock").joinpath("slave.py").read_text(encoding="utf-8")
    content = content_hash({path: text.encode() for path, text in sources.items()})
    # names with the hash: two FMUs in one process would otherwise share modules of the same name
    package, slave = f"{name}_{content}", f"{name}_{content}_slave"
    resources = move_into_package(sources, package)
    resources[f"{slave}.py"] = _SLAVE.format(
        block=name, module=module, package=package, path=module.replace(".", "/") + ".py", content=content
    )
    resources["slavemodule.txt"] = slave
    for file in _pythonfmu().glob("*.py"):
        resources[f"pythonfmu/{file.name}"] = file.read_text(encoding="utf-8")
    host = _HOST.format(pythonfmu=version("pythonfmu"))
    return draft(
        block,
        symbolic,
        producer,
        documents,
        {f"resources/{path}": text.encode() for path, text in resources.items()}
        | {"documentation/externalDependencies.txt": host.encode()},
        FmuFeatures(),
    )


def python_binaries(draft: Draft) -> dict[str, bytes]:
    """Return PythonFMU's binaries for all its platforms, by path. Raises BuildError without them."""
    name = type(draft.block).__name__
    binaries = {}
    # PythonFMU brings its binaries; nothing is compiled, for any platform
    for file in sorted(_pythonfmu().glob("resources/binaries/*/*")):
        binaries[f"binaries/{file.parent.name}/{name}{file.suffix}"] = file.read_bytes()
    if not binaries:
        raise BuildError("the installed pythonfmu package has no binaries; install its wheel from PyPI.")
    return binaries


def _pythonfmu() -> Path:
    """Return the installed package's folder; an imported one may come from a PythonFMU FMU that runs here."""
    return Path(str(distribution("pythonfmu").locate_file("pythonfmu")))

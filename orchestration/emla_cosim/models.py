"""Our own models: which there are, where their FMUs lie, and how they are built."""

import zipfile
from collections.abc import Callable, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from fmpy import read_model_description

import emla_fmu
import rsba_fmu
from fmublock import Block
from fmublock.description import Producer
from fmublock.export import BuildError, Documents, Draft
from fmublock.native import TARGETS, build_native, host_platform, native_draft
from fmublock.python_flavour import build_python, python_draft

from .errors import RunError, check_choice

MODELS: dict[str, type[Block]] = {b.__name__: b for b in (*emla_fmu.BLOCKS, *rsba_fmu.BLOCKS)}
"""Blocks by the name of their model."""

PLATFORMS = tuple(TARGETS)
"""FMI platforms that native FMUs are built for, from any machine."""

FLAVOURS = ("native", "python")
"""Native FMUs run anywhere; PythonFMU FMUs need a Python host and are readable inside."""

FMU_FOLDER = Path("fmus")
"""Where FMUs are built to and looked for unless told otherwise."""


def fmu_path(model: str, flavour: str, folder: Path) -> Path:
    """Where the FMU of a model lies: <folder>/<Model>/<Model>.fmu, PythonFMU's in python/ below."""
    inside = folder / model if flavour == "native" else folder / model / "python"
    return inside / f"{model}.fmu"


def build(
    model: str,
    flavour: str,
    platforms: Sequence[str],
    folder: Path,
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Build the FMU of a model, unless the very same is there already; returns its file.

    `platforms` are FMI platforms for native FMUs; none is this machine's and those that the
    file has already. `advance` is called for each binary as it is compiled. Raises CommandError
    for an unknown name, RunError where building or writing fails.
    """
    check_choice("model", model, MODELS)
    check_choice("flavour", flavour, FLAVOURS)
    for platform in platforms:
        check_choice("platform", platform, PLATFORMS)
    block, documents = MODELS[model](), _documents(model)
    path = fmu_path(model, flavour, folder)
    present = _platforms_of(path)
    try:
        if flavour == "native":
            wanted = platforms or sorted({host_platform(), *(present & set(PLATFORMS))})
            draft = native_draft(block, _producer(), documents)
            if not (_is_current(path, draft) and present.issuperset(wanted)):
                build_native(draft, wanted, path, advance)
        else:
            draft = python_draft(block, _producer(), documents)
            if not _is_current(path, draft):
                build_python(draft, path)
    except BuildError as error:
        raise RunError(f"{model} could not be built: {error}") from error
    except OSError as error:
        raise RunError(f"the FMU '{path}' cannot be written: {error.strerror or error}.") from error
    return path


def _platforms_of(path: Path) -> set[str]:
    """FMI platforms that an FMU has binaries for; none if there is no such FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    except (OSError, zipfile.BadZipFile):
        return set()


def _is_current(path: Path, draft: Draft) -> bool:
    """Whether the file has the GUID of what would be built."""
    try:
        return read_model_description(str(path)).guid == draft.guid
    except Exception:  # missing, cut off or not an FMU: build it
        return False


def _producer() -> Producer:
    return Producer("EMLA-Cosim fmublock", version("emla-cosim"), "MIT")


def _documents(model: str) -> Documents:
    root = _documents_root()
    return Documents(
        readme=(root / "fmus" / model / "README.md").read_text(encoding="utf-8"),
        license=(root / "LICENSE").read_text(encoding="utf-8"),
    )


def _documents_root() -> Path:
    """Where LICENSE and fmus/ lie: inside the installed package, or the top of the source tree."""
    packaged = Path(str(files("emla_cosim"))) / "documents"
    return packaged if packaged.is_dir() else Path(__file__).parents[2]

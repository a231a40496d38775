"""Our own models: which there are, where their FMUs lie, and how they are built.

Whether an FMU is up to date is known from a key, before anything that builds one is imported.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path

import emla_fmu
import hdrm_fmu
import rsba_fmu
from fmublock import Block
from fmublock.archive import BuiltFmu, read_built
from fmublock.cache import cache_folder
from fmublock.errors import BuildError, LoadError
from fmublock.platforms import TARGETS, host_platform
from fmublock.recipe import FLAVOURS, Documents, Producer, Recipe

from ..base.errors import CommandError, RunError, check_choice
from ..base.ownership import check_replaceable

__all__ = ["FLAVOURS", "FMU_FOLDER", "MODELS", "PLATFORMS", "build", "find_block", "fmu_path"]

MODELS: dict[str, type[Block]] = {
    b.__name__: b for b in (*emla_fmu.BLOCKS, *rsba_fmu.BLOCKS, *hdrm_fmu.BLOCKS)
}
"""Blocks by the name of their model."""

PLATFORMS = tuple(TARGETS)
"""FMI platforms that native FMUs are built for, from any machine."""

FMU_FOLDER = Path("fmus")
"""Where `emla build` builds to, and whose FMUs come before those of the user's cache."""


def find_block(name: str) -> type[Block]:
    """The block that a name means: one of our models, or FILE.py:BLOCK. Raises CommandError."""
    if ".py:" not in name:
        check_choice("model", name, MODELS)
        return MODELS[name]
    from fmublock import load_block

    try:
        return load_block(name)
    except LoadError as error:
        raise CommandError(str(error), name=name) from error


def fmu_path(model: str, flavour: str, folder: Path) -> Path:
    """Where the FMU of a model lies: <folder>/<Model>/<Model>.fmu, PythonFMU's in python/ below."""
    inside = folder / model if flavour == "native" else folder / model / "python"
    return inside / f"{model}.fmu"


def build(
    model: str | type[Block],
    flavour: str,
    platforms: Sequence[str],
    folder: Path | None = None,
    advance: Callable[[], None] = lambda: None,
    overwrite: bool = False,
) -> Path:
    """Build the FMU of a model, unless the very same is there already; returns its file.

    `model` is the name of one of ours, or anybody's block. `platforms` are FMI platforms for native
    FMUs; none is this machine's and those that the file has already. The FMU lies in `folder`;
    without one in fmus/ of the current folder if it has one of this model, and else in the user's
    cache, by what it is made of. Processes that want the same FMU build it once. `advance` is called
    for each binary as it is compiled. A file that is no FMU of ours is only replaced with `overwrite`.

    Raises CommandError for an unknown name, and for a file that may not be replaced; RunError where
    building or writing fails.
    """
    if isinstance(model, str):
        check_choice("model", model, MODELS)
    check_choice("flavour", flavour, FLAVOURS)
    for platform in platforms:
        check_choice("platform", platform, PLATFORMS)
    name = model if isinstance(model, str) else model.__name__
    try:
        return _build(_recipe(model, flavour), platforms, folder, advance, overwrite)
    except BuildError as error:
        raise RunError(f"{name} could not be built: {error}") from error
    except OSError as error:
        raise RunError(f"{name} could not be built: {error}.") from error


def check_build_path(
    model: str | type[Block], flavour: str, folder: Path | None = None, overwrite: bool = False
) -> None:
    """Raise CommandError where building an FMU would replace what is no FMU of ours; see `build`.

    Nothing is built, so all FMUs of a command can be checked before the first one is.
    """
    name = model if isinstance(model, str) else model.__name__
    path = fmu_path(name, flavour, FMU_FOLDER if folder is None else folder)
    there = next((p for p in path.parents if os.path.lexists(p)), FMU_FOLDER)
    if folder is not None and not os.path.isdir(there):  # noqa: PTH112 (it raises nothing)
        raise CommandError(f"the FMU '{path}' cannot be written: '{there}' is no folder.")
    if os.path.islink(path) and _is_ours(path):  # noqa: PTH114 (it raises nothing)
        return  # it need not be written, if it is up to date
    is_there = os.path.isfile if folder is None else os.path.lexists
    if is_there(path):
        check_replaceable(path, "the FMU", _is_ours, overwrite)


def _is_ours(path: Path) -> bool:
    return read_built(path).key is not None


def _build(
    recipe: Recipe,
    platforms: Sequence[str],
    folder: Path | None,
    advance: Callable[[], None],
    overwrite: bool,
) -> Path:
    key, draft = recipe.key(), None
    if key is None:  # its content has to tell
        from fmublock.building import draft_of

        draft = draft_of(recipe)
        key = draft.key
    path = _place(recipe, key, folder)
    if _is_current(read_built(path), recipe, key, platforms):
        return path
    with _lock_build(path):
        built = read_built(path)  # another process may have built it meanwhile
        if not _is_current(built, recipe, key, platforms):
            if os.path.lexists(path) and (folder is not None or not path.is_absolute()):  # not in the cache
                check_replaceable(path, "the FMU", _is_ours, overwrite)
            from fmublock.building import draft_of, write_fmu

            wanted = platforms or sorted({host_platform(), *(built.platforms & set(PLATFORMS))})
            write_fmu(draft or draft_of(recipe), key, recipe.flavour, wanted, path, advance)
    return path


def _is_current(built: BuiltFmu, recipe: Recipe, key: str, platforms: Sequence[str]) -> bool:
    wanted = platforms or (host_platform(),)
    return built.key == key and (recipe.flavour != "native" or built.platforms.issuperset(wanted))


def _place(recipe: Recipe, key: str, folder: Path | None) -> Path:
    if folder is not None:
        return fmu_path(recipe.model, recipe.flavour, folder)
    here = fmu_path(recipe.model, recipe.flavour, FMU_FOLDER)
    if here.is_file():
        return here
    return cache_folder() / "fmus" / f"{recipe.model}-{key[:24]}" / f"{recipe.model}.fmu"


@contextmanager
def _lock_build(path: Path) -> Iterator[None]:
    """Wait until no other process builds the FMU at this path."""
    from filelock import FileLock

    locks = cache_folder() / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:24]
    with FileLock(locks / f"{name}.lock"):
        yield


def _recipe(model: str | type[Block], flavour: str) -> Recipe:
    if not isinstance(model, str):
        return Recipe.of(model, flavour)
    return Recipe(MODELS[model](), flavour, producer("MIT"), _documents(model))


def producer(license_name: str | None = None) -> Producer:
    """Who makes our FMUs, and under which licence."""
    from importlib.metadata import version  # takes a while

    return Producer("EMLA-Cosim fmublock", version("emla-cosim"), license_name)


def _documents(model: str) -> Documents:
    readme = documents_root() / "fmus" / model / "README.md"
    return Documents(readme=readme.read_text(encoding="utf-8"), license=license_text())


def license_text() -> str:
    """The licence of our programs."""
    return (documents_root() / "LICENSE").read_text(encoding="utf-8")


def documents_root() -> Path:
    """Where LICENSE and fmus/ lie: inside the installed package, or the top of the source tree."""
    packaged = Path(str(files("emla_cosim"))) / "documents"
    return packaged if packaged.is_dir() else Path(__file__).parents[3]

"""Our own models: their names, the places of their FMUs, and how to build them.

A key shows whether an FMU is up to date, without importing the modules that build one.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.resources import files
from pathlib import Path

import emla_fmu
import machine_fmu
import rsba_fmu
from fmublock import Block
from fmublock.archive import BuiltFmu, read_built
from fmublock.cache import cache_folder, find_prebuilt
from fmublock.disclosure import Disclosure
from fmublock.errors import BuildError, DisclosureError, LoadError, VersionError
from fmublock.files import accept, write_atomically
from fmublock.platforms import FMI_VERSIONS as FMI_VERSIONS
from fmublock.platforms import TARGETS, host_platform
from fmublock.recipe import FLAVOURS, Documents, Producer, Recipe, RelatedFile

from ..base.errors import CommandError, RunError, check_choice
from ..base.extras import explain_missing
from ..base.output_files import OutputFile


class _Models(Mapping[str, type[Block]]):
    """Blocks by the name of their model. Those of the manipulator are made of its file when they are used."""

    def __init__(self, blocks: Mapping[str, type[Block] | str]) -> None:
        self._blocks = blocks

    def __getitem__(self, name: str) -> type[Block]:
        block = self._blocks[name]
        if isinstance(block, str):
            study = import_module("emla_cosim.study.machines.blocks")  # this room does not know the study
            return getattr(study.manipulator_blocks(), block)
        return block

    def __iter__(self) -> Iterator[str]:
        return iter(self._blocks)

    def __len__(self) -> int:
        return len(self._blocks)

    def __contains__(self, name: object) -> bool:
        return name in self._blocks  # without making a block


MODELS: Mapping[str, type[Block]] = _Models(
    {
        **{block.__name__: block for block in (*emla_fmu.BLOCKS, *rsba_fmu.BLOCKS)},
        "HdrmManipulator": "load",
        "HdrmPlant": "plant",
        **{block.__name__: block for block in machine_fmu.BLOCKS},
    }
)
"""The blocks by the name of their model."""

PLATFORMS = tuple(TARGETS)
"""FMI platforms for which native FMUs can be built on any machine."""

FMU_FOLDER = Path("fmus")
"""The folder in which `emla build` puts FMUs; these take precedence over those of the user's cache."""


def find_block(name: str) -> type[Block]:
    """Return one of our models by its name, or a block of a file by `FILE.py:BLOCK`.

    Raises:
        CommandError: If it does not exist or cannot be loaded.
    """
    if ".py:" not in name:
        check_choice("model", name, MODELS)
        return MODELS[name]
    from fmublock import load_block

    try:
        return load_block(name)
    except LoadError as error:
        raise CommandError(str(error), name=name) from error


def fmu_path(model: str, flavour: str, folder: Path) -> Path:
    """Return the path of a model's FMU: `MODEL/MODEL.fmu`, for PythonFMU `MODEL/python/MODEL.fmu`."""
    inside = folder / model if flavour == "native" else folder / model / "python"
    return inside / f"{model}.fmu"


def build(
    model: str | type[Block],
    flavour: str,
    platforms: Sequence[str],
    folder: Path | None = None,
    advance: Callable[[], None] = lambda: None,
    overwrite: bool = False,
    disclosure: Disclosure | None = None,
    fmi: int = 2,
    clock: float | None = None,
) -> Path:
    """Build the FMU of a model, unless the same one already exists.

    Processes that need the same FMU build it once.

    Args:
        model: The name of one of our models, or any block.
        flavour: One of `FLAVOURS`.
        platforms: FMI platforms of native FMUs. Default: that of this machine, and those of an existing file.
        folder: The folder of the FMU. Default: `fmus/` in the working folder if it has an FMU of this model,
            otherwise the user's cache.
        advance: Called for each compiled binary.
        overwrite: Whether to replace a file that is not an FMU of ours.
        disclosure: What the FMU contains and lets its user set. Default: everything. With anything
            else, `folder` is required and is not that of our own FMUs.
        fmi: Version of FMI: 2, or 3 for native FMUs. `folder` is as for `disclosure` if it is 3.
        clock: Interval of a periodic input clock in s, for FMI 3.0. Default: no clock.

    Returns:
        The path of the FMU.

    Raises:
        CommandError: If a name or a value is wrong, or the file must not be replaced.
        MissingExtraError: If the FMU must be built, and a package for it is not installed.
        RunError: If building or writing fails.
    """
    if isinstance(model, str):
        check_choice("model", model, MODELS)
    check_choice("flavour", flavour, FLAVOURS)
    for platform in platforms:
        check_choice("platform", platform, PLATFORMS)
    if disclosure is not None or fmi != 2 or clock is not None:
        check_disclosure(model, flavour, folder, disclosure or Disclosure(), fmi, clock)
    name = model_name(model)
    try:
        return _find_or_build(
            _make_recipe(model, flavour, disclosure, fmi, clock), platforms, folder, advance, overwrite
        )
    except BuildError as error:
        raise RunError(f"{name} could not be built: {error}") from error
    except OSError as error:
        raise RunError(f"{name} could not be built: {error}.") from error
    except ImportError as error:
        raise explain_missing(error, f"building {name}") or error from error


def model_name(model: str | type[Block]) -> str:
    """Return the name of a model that is one of ours, or a block."""
    return model if isinstance(model, str) else model.__name__


def check_disclosure(
    model: str | type[Block],
    flavour: str,
    folder: Path | None,
    disclosure: Disclosure,
    fmi: int = 2,
    clock: float | None = None,
) -> None:
    """Check that a model can be built with this disclosure and version, in this folder. This builds nothing.

    Raises:
        CommandError: If it cannot.
        RunError: If the declarations of the block are wrong.
    """
    try:
        _make_recipe(model, flavour, disclosure, fmi, clock)
    except BuildError as error:
        raise RunError(f"{model_name(model)} could not be built: {error}") from error
    is_other = disclosure != Disclosure() or fmi != 2
    if is_other and (folder is None or folder.resolve() == FMU_FOLDER.resolve()):
        kind = "complete FMUs" if fmi == 2 else "FMUs for FMI 2.0"
        raise CommandError(
            f"the folder '{FMU_FOLDER}' is for {kind}, which `emla run` uses and builds again; "
            "choose another one with --output."
        )


def check_build_path(
    model: str | type[Block], flavour: str, folder: Path | None = None, overwrite: bool = False
) -> None:
    """Check that building an FMU replaces no file that is not an FMU of ours; see `build`.

    This builds nothing, so that a command can check all its FMUs first.

    Raises:
        CommandError: If it does.
    """
    name = model_name(model)
    path = fmu_path(name, flavour, FMU_FOLDER if folder is None else folder)
    there = next((p for p in path.parents if os.path.lexists(p)), FMU_FOLDER)
    if folder is not None and not os.path.isdir(there):  # noqa: PTH112 (it raises nothing)
        raise CommandError(f"the FMU '{path}' cannot be written: '{there}' is not a folder.")
    if os.path.islink(path) and _is_ours(path):  # noqa: PTH114 (it raises nothing)
        return  # an up-to-date FMU is not written
    is_there = os.path.isfile if folder is None else os.path.lexists
    if is_there(path):
        OutputFile(path, "the FMU", _is_ours, overwrite)


def _is_ours(path: Path) -> bool:
    return read_built(path).key is not None


def _find_or_build(
    recipe: Recipe,
    platforms: Sequence[str],
    folder: Path | None,
    advance: Callable[[], None],
    overwrite: bool,
) -> Path:
    """Return the path of an FMU, which is built only if neither its file nor a prebuilt one is up to date."""
    key, draft = recipe.key(), None
    if key is None:  # the key follows from the content
        from fmublock.building import draft_of

        draft = draft_of(recipe)
        key = draft.key
    path = _choose_path(recipe, key, folder)
    if _is_up_to_date(read_built(path), recipe, key, platforms):
        return path
    prebuilt = find_prebuilt(*_cache_parts(recipe, key))
    if prebuilt is not None and not _is_up_to_date(read_built(prebuilt), recipe, key, platforms):
        prebuilt = None
    in_cache = folder is None and path.is_absolute()
    if prebuilt is not None and in_cache:
        return prebuilt
    # without a lock up to here: most calls find the FMU
    with _lock_build(path):
        built = read_built(path)  # another process may have built it meanwhile
        if not _is_up_to_date(built, recipe, key, platforms):
            file = None if in_cache else OutputFile(path, "the FMU", _is_ours, overwrite, creates_folder=True)
            check = accept if file is None else file.check_again
            if prebuilt is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                with write_atomically(path, check) as stream:
                    stream.write(prebuilt.read_bytes())
                return path
            from fmublock.building import draft_of, write_fmu

            needed = platforms or sorted({host_platform(), *(built.platforms & set(PLATFORMS))})
            write_fmu(draft or draft_of(recipe), key, recipe.flavour, needed, path, advance, check)
    return path


def _is_up_to_date(built: BuiltFmu, recipe: Recipe, key: str, platforms: Sequence[str]) -> bool:
    """Return whether an existing FMU has this content, and binaries for these platforms."""
    needed = platforms or (host_platform(),)
    return built.key == key and (recipe.flavour != "native" or built.platforms.issuperset(needed))


def _choose_path(recipe: Recipe, key: str, folder: Path | None) -> Path:
    """Return the path of the FMU; without a folder, that in `FMU_FOLDER` if it exists, or in the cache."""
    if folder is not None:
        return fmu_path(recipe.model, recipe.flavour, folder)
    local_path = fmu_path(recipe.model, recipe.flavour, FMU_FOLDER)
    if local_path.is_file():
        return local_path
    return cache_folder().joinpath(*_cache_parts(recipe, key))


def _cache_parts(recipe: Recipe, key: str) -> tuple[str, str, str]:
    """Return folders and name of an FMU in a cache."""
    return "fmus", f"{recipe.model}-{key[:24]}", f"{recipe.model}.fmu"


@contextmanager
def _lock_build(path: Path) -> Iterator[None]:
    """Wait until no other process builds the FMU at this path."""
    from filelock import FileLock

    locks = cache_folder() / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:24]
    with FileLock(locks / f"{name}.lock"):
        yield


_REFERENCES = {
    "ref.csv": ("result", "text/csv", "Reference solution"),
    "in.csv": ("testcase", "text/csv", "Inputs of the reference solution"),
    "ref.opt": ("testcase", "text/plain", "Times of the reference solution"),
    "ref.toml": (
        "testcase",
        "application/toml",
        "Start values, tolerances and origin of the reference solution",
    ),
    "ref.ssv": ("parameter", "application/x-ssp-parameter-set", "Start values of the reference solution"),
    "validation.exp": (
        "experiment/validation",
        "application/x-ma-hs-experiments",
        "Experiment with the reference solution",
    ),
    "smoke_test.exp": (
        "experiment/smoke-test",
        "application/x-ma-hs-experiments",
        "First steps of the experiment with the reference solution",
    ),
}
"""Role, type and description of the reference files of a model, by the end of their names."""


def _make_recipe(
    model: str | type[Block],
    flavour: str,
    disclosure: Disclosure | None = None,
    fmi: int = 2,
    clock: float | None = None,
) -> Recipe:
    """Return the recipe of a model. Raise CommandError if the disclosure or the version does not fit it."""
    try:
        if not isinstance(model, str):
            return Recipe.of(model, flavour, disclosure=disclosure, fmi=fmi, clock=clock)
        complete = disclosure is None or disclosure.has_sources
        documents = (
            _list_documents(model, has_results=clock is None)
            if complete
            else Documents(license=license_text())
        )
        return Recipe.of(MODELS[model], flavour, producer("MIT"), documents, disclosure, fmi, clock)
    except (DisclosureError, VersionError) as error:
        name = model_name(model)
        raise CommandError(f"{name}: {error}", model=name) from error


@cache
def producer(license_name: str | None = None) -> Producer:
    """Return the generator name, version and license that our FMUs contain."""
    from importlib.metadata import version  # slow to import

    return Producer("EMLA-Cosim fmublock", version("emla-cosim"), license_name)


def _list_documents(model: str, has_results: bool) -> Documents:
    """Return the documents of a model; its results are those of steps, not of the ticks of a clock."""
    folder = documents_root() / "fmus" / model
    related = [
        RelatedFile(path.name, path.read_text(encoding="utf-8"), role, type_, f"{description} of {model}")
        for kind, (role, type_, description) in _REFERENCES.items()
        if has_results and (path := folder / f"{model}_{kind}").is_file()
    ]
    readme = (folder / "README.md").read_text(encoding="utf-8")
    return Documents(readme=readme, license=license_text(), related=tuple(related))


def license_text() -> str:
    """Return the license of our programs."""
    return (documents_root() / "LICENSE").read_text(encoding="utf-8")


def documents_root() -> Path:
    """Return the folder with LICENSE and fmus/: in the installed package, or the root of the source tree."""
    packaged = Path(str(files("emla_cosim"))) / "documents"
    return packaged if packaged.is_dir() else Path(__file__).parents[3]

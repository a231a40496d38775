"""Load blocks from Python files that are not installed: `mine.py:Drive`."""

import importlib.util
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from .block import Block
from .errors import LoadError


def load_block(block_path: str) -> type[Block]:
    """Return the block class that a text names.

    The file runs as if it were imported, and can import modules beside it. In a folder with an `__init__.py`
    it is a module of that package. The modules do not stay imported.

    Args:
        block_path: FILE.py:BLOCK.

    Raises:
        LoadError: the file or the block does not exist, or the file fails.
    """
    name, _, block = block_path.rpartition(":")
    if not name or not block.isidentifier():
        raise LoadError(f"'{block_path}' does not name a block; write FILE.py:BLOCK.")
    file = Path(name)
    if not file.is_file():
        raise LoadError(f"there is no file '{name}'.")
    module = _run_file(file.resolve())
    block_class = getattr(module, block, None)
    blocks = _defined_blocks(module)
    if block_class is None:
        choice = f"its blocks are {', '.join(blocks)}" if blocks else "it defines no block"
        raise LoadError(f"'{name}' has no {block}; {choice}.")
    if not _is_block(block_class):
        raise LoadError(f"{block} of '{name}' is not a block; derive it from fmublock.Block.")
    return block_class


def load_blocks(file: Path) -> dict[str, type[Block]]:
    """Return the block classes that a file defines, by name; see `load_block`.

    Raises:
        LoadError: the file fails.
    """
    return _defined_blocks(_run_file(file.resolve()))


def _defined_blocks(module: ModuleType) -> dict[str, type[Block]]:
    return {n: x for n, x in vars(module).items() if _is_block(x) and x.__module__ == module.__name__}


def _is_block(thing: object) -> bool:
    return isinstance(thing, type) and issubclass(thing, Block) and thing is not Block


def _run_file(file: Path) -> ModuleType:
    """Run the file and return it as a module."""
    root, parts = file.parent, [re.sub(r"\W", "_", file.stem)]
    while (root / "__init__.py").is_file():
        root, parts = root.parent, [root.name, *parts]
    name = ".".join(parts)
    spec = importlib.util.spec_from_file_location(name, file, loader=_SourceLoader(name, str(file)))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with _import_from(root):
        try:
            if len(parts) > 1:
                importlib.import_module(name.rpartition(".")[0])
            sys.modules[name] = module
            spec.loader.exec_module(module)
        except SyntaxError as error:
            culprit = Path(error.filename or file).name
            raise LoadError(
                f"'{culprit}' is not valid Python: {error.msg} in line {error.lineno}."
            ) from error
        # a script that calls sys.exit must not end the command
        except (Exception, SystemExit) as error:
            line = _describe_line(error, file)
            text = str(error).splitlines() or [""]
            raise LoadError(f"'{file.name}' fails{line}: {type(error).__name__}: {text[0]}.") from error
    return module


class _SourceLoader(SourceFileLoader):
    """Compiles a file each time, and writes nothing beside it.

    Python takes bytecode for that of a file with the same size and time in s: a file that a program changes
    twice within a second would run as it was before.
    """

    def get_code(self, fullname: str) -> CodeType:
        """Return the code of the file as it is now."""
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _FolderFinder(MetaPathFinder):
    """Finds modules in one folder, and in packages there."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module; None if it is not in the folder."""
        if path is not None and not all(Path(folder).is_relative_to(self._folder) for folder in path):
            return None
        spec = PathFinder.find_spec(fullname, [str(self._folder)] if path is None else path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _SourceLoader(spec.loader.name, spec.loader.path)
        return spec


@contextmanager
def _import_from(folder: Path) -> Iterator[None]:
    """Import from this folder first, and forget its modules afterwards."""

    def is_in_folder(module: str) -> bool:
        top = module.split(".")[0]
        exists = (folder / f"{top}.py").is_file() or (folder / top / "__init__.py").is_file()
        return exists and top not in sys.stdlib_module_names and top != __package__

    # an imported module of the same name must not replace the one beside the block
    hidden_modules = {name: module for name, module in sys.modules.items() if is_in_folder(name)}
    for name in hidden_modules:
        del sys.modules[name]
    finder = _FolderFinder(folder)
    sys.meta_path.insert(0, finder)
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        for name in [n for n in sys.modules if is_in_folder(n)]:
            del sys.modules[name]
        sys.modules.update(hidden_modules)


def _describe_line(error: BaseException, file: Path) -> str:
    """Return the last line of the file that was run, such as ` in line 3`."""
    line, traceback = "", error.__traceback__
    while traceback is not None:
        if traceback.tb_frame.f_code.co_filename == str(file):
            line = f" in line {traceback.tb_lineno}"
        traceback = traceback.tb_next
    return line

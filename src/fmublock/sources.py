"""Gather the Python files that a block needs to run inside an FMU."""

import ast
import importlib.util
import re
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from .block import Block, Origin
from .errors import BuildError

_PACKAGE = "fmublock"
_IMPORT_ROOT = Path(__file__).parents[1]
_AVAILABLE_MODULES = {_PACKAGE, *sys.stdlib_module_names}
_READERS = {"configparser", "fileinput", "importlib", "io", "linecache", "os", "pathlib", "pkgutil", "shelve"}
_READERS |= {"sqlite3", "subprocess", "urllib"}
"""Modules that read files or the like."""


@dataclass
class Sources:
    """Texts of Python files by path relative to the import root, and the other modules they import.

    `foreign` has the modules that are neither among the files nor in the standard library, by the name
    of the module that imports them. `reads_files` is whether a file outside the folder of fmublock seems to
    read others, so that equations can have numbers from these.
    """

    texts: dict[str, str] = field(default_factory=dict)
    foreign: dict[str, set[str]] = field(default_factory=dict)
    reads_files: bool = False

    def refuse_foreign(self) -> None:
        """Raise BuildError if a file imports a foreign module, which an FMU's host may not have."""
        for module, names in self.foreign.items():
            raise BuildError(
                f"{module} imports {', '.join(sorted(names))}; a block may import the standard library only."
            )


def module_of(block: type[Block]) -> str:
    """Return the module name of a block inside an FMU; for a script, its file's name."""
    name, file = block.origin.module, block.origin.file
    return re.sub(r"\W", "_", Path(file).stem) if name == "__main__" and file is not None else name


def gather_sources(block: type[Block], *more: str) -> Sources:
    """Gather the file that defines a block, and those that it and its base classes import.

    These are files of their packages, and files beside a module that is in no package.

    Args:
        block: The block class.
        more: Further modules of fmublock, which are added with all that they import.

    Raises:
        BuildError: A block has no file, or a file has changed since the block was defined.
    """
    bases = [base for base in block.__mro__ if issubclass(base, Block) and base is not Block]
    files: dict[str, Path] = {}
    for base in bases:
        if base.origin.module.split(".")[0] != _PACKAGE:
            files[module_of(base)] = _find_block_file(base)
    # the key of an FMU has the text of fmublock anyway; only the FMU itself needs these modules
    search = _Search(files, follow_own=bool(more))
    gathered = Sources()
    waiting = [*files, *(f"{_PACKAGE}.{name}" for name in more)]
    while waiting:
        module = waiting.pop()
        if "." in module:
            waiting.append(module.rpartition(".")[0])
        file = search.find(module)
        path = "" if file is None else _get_path(module, file)
        if file is None or path in gathered.texts:  # a folder may be a package without a file
            continue
        text = _read(file, None if module.split(".")[0] == _PACKAGE else block.origin)
        gathered.texts[path] = text
        # numbers from other files could change the FMU while its key stays
        is_outside = not file.is_relative_to(_IMPORT_ROOT)
        gathered.reads_files |= is_outside and re.search(r"\bopen\(", text) is not None
        package = module if file.name == "__init__.py" else module.rpartition(".")[0]
        for name, submodules in _list_imports(text, package, file):
            gathered.reads_files |= is_outside and name.split(".")[0] in _READERS
            imported_file = search.find(name)
            # a file, unlike a package, has no modules inside
            for candidate in (
                [name]
                if imported_file is not None and imported_file.name != "__init__.py"
                else [name, *submodules]
            ):
                if search.find(candidate) is not None:
                    waiting.append(candidate)
                elif search.is_foreign(candidate):
                    gathered.foreign.setdefault(module, set()).add(candidate.split(".")[0])
    return gathered


def move_into_package(sources: Mapping[str, str], package: str) -> dict[str, str]:
    """Move the files into `package` and rewrite their imports of each other.

    Without this, two FMUs in one process could run each other's modules, or the installed ones.
    """
    roots = {path.split("/")[0].removesuffix(".py") for path in sources}
    rewritten = {
        f"{package}/{path}": _rewrite_imports(text, package, roots) for path, text in sources.items()
    }
    return {f"{package}/__init__.py": "", **rewritten}


class _Search:
    """Finds the modules that belong to a block, by name."""

    def __init__(self, files: Mapping[str, Path], follow_own: bool) -> None:
        self._files = files
        self._roots: dict[str, Path] = {_PACKAGE: _IMPORT_ROOT} if follow_own else {}
        self._folders: list[Path] = []
        self._files_by_module: dict[str, Path | None] = {}
        installed = _installed_folders()
        for module, file in files.items():
            if "." in module:
                self._roots[module.split(".")[0]] = file.parents[module.count(".")]
            elif file.parent not in installed:
                self._folders.append(file.parent)

    def find(self, module: str) -> Path | None:
        """Return the file of a module, if it belongs to the block."""
        if module not in self._files_by_module:
            self._files_by_module[module] = self._find(module)
        return self._files_by_module[module]

    def _find(self, module: str) -> Path | None:
        if module in self._files:
            return self._files[module]
        top = module.split(".")[0]
        folders = [] if top in _AVAILABLE_MODULES else self._folders
        for root in [self._roots[top]] if top in self._roots else folders:
            path = root.joinpath(*module.split("."))
            for file in (path.with_name(f"{path.name}.py"), path / "__init__.py"):
                if _has_file(root, file):
                    return file
        return None

    def is_foreign(self, name: str) -> bool:
        """Return whether a name that is not a file of the block is a foreign module."""
        top = name.split(".")[0]
        return top not in _AVAILABLE_MODULES and self.find(top) is None


def _has_file(root: Path, file: Path) -> bool:
    """Return whether a file exists below a folder under exactly this name.

    On file systems that ignore case, `from fmublock import Block` would add `block.py` again as `Block.py`.
    """
    if not file.is_file():
        return False
    paths = [file, *file.parents][: len(file.relative_to(root).parts)]
    return all(path.name in (entry.name for entry in path.parent.iterdir()) for path in paths)


@cache
def _installed_folders() -> frozenset[Path]:
    """Return the folders of installed packages."""
    return frozenset(Path(sysconfig.get_path(name)) for name in ("purelib", "platlib"))


def _find_block_file(block: type[Block]) -> Path:
    file = None if block.origin.file is None else Path(block.origin.file)
    top_level = None if file is None or not file.is_file() else _parse_top_level(_read(file, block.origin))
    if file is None or not isinstance(top_level, _TopLevel) or block.__qualname__ not in top_level.classes:
        raise BuildError(
            f"{block.__name__} is not defined at the top of a Python file, whose text could go into an FMU."
        )
    return file


def _get_path(module: str, file: Path) -> str:
    return module.replace(".", "/") + ("/__init__.py" if file.name == "__init__.py" else ".py")


def _read(file: Path, origin: Origin | None) -> str:
    """Read a file, which must not have changed since the block's origin, if there is one."""
    # the FMU would get other equations than those that were checked
    if origin is not None and file.stat().st_mtime > origin.time:
        raise BuildError(
            f"'{file}' has changed since {origin.module} was imported; import it again, in a new process."
        )
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise BuildError(f"'{file}' is not encoded as UTF-8.") from None


def _list_imports(text: str, package: str, file: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the modules that a text imports, and what may be modules inside: a.b of `from a import b`."""
    top_level = _parse_top_level(text)
    if isinstance(top_level, SyntaxError):
        raise BuildError(f"'{file}' is not valid Python: {top_level.msg} in line {top_level.lineno}.")
    for level, base, names in top_level.imports:
        if level < 0:
            yield from ((name, []) for name in names)
            continue
        base = importlib.util.resolve_name("." * level + base, package) if level else base
        yield base, [f"{base}.{name}" for name in names]


@dataclass(frozen=True)
class _TopLevel:
    """The classes at the top of a text, and its imports.

    An import is the number of dots before the module (-1 for `import a`), the module, and the names.
    """

    classes: frozenset[str]
    imports: Sequence[tuple[int, str, tuple[str, ...]]]


@cache
def _parse_top_level(text: str) -> _TopLevel | SyntaxError:
    """Return the outline of a text, or why it is not valid Python."""
    try:
        body = ast.parse(text).body
    except SyntaxError as error:
        return error
    classes = frozenset(node.name for node in body if isinstance(node, ast.ClassDef))
    return _TopLevel(classes, list(_find_import_statements(body)))


def _find_import_statements(block: Sequence[ast.AST]) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """Yield the imports of statements, except for those that only type checkers see."""
    for node in block:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = tuple(alias.name for alias in node.names)
            is_from = isinstance(node, ast.ImportFrom)
            yield (node.level, node.module or "", names) if is_from else (-1, "", names)
            continue
        hidden = isinstance(node, ast.If) and _is_for_type_checkers(node.test)
        for name in ("orelse",) if hidden else _BLOCKS:
            if inner := getattr(node, name, None):
                yield from _find_import_statements(inner)


_BLOCKS = ("body", "handlers", "orelse", "finalbody", "cases")
"""Attributes of statements that hold statements."""


def _is_for_type_checkers(test: ast.expr) -> bool:
    """Return whether a condition is false when a program runs, because it has TYPE_CHECKING."""
    if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And):
        return any(_is_for_type_checkers(value) for value in test.values)
    name = test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", "")
    return name == "TYPE_CHECKING"


def _rewrite_imports(text: str, package: str, roots: set[str]) -> str:
    """Rewrite absolute imports of `roots` to imports from inside `package`."""
    lines = text.encode().splitlines(keepends=True)
    nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]
    # from the last to the first, so that positions of earlier statements stay valid
    for node in sorted(nodes, key=lambda n: (n.lineno, n.col_offset), reverse=True):
        start, end = node.lineno - 1, (node.end_lineno or node.lineno) - 1
        before, after = lines[start][: node.col_offset], lines[end][node.end_col_offset :]
        statement = b"".join(lines[start : end + 1])[node.col_offset :]
        statement = statement[: len(statement) - len(after)].decode()
        rewritten = _rewrite_import(node, statement, package, roots)
        lines[start : end + 1] = (before + rewritten.encode() + after).splitlines(keepends=True)
    return b"".join(lines).decode()


def _rewrite_import(node: ast.Import | ast.ImportFrom, statement: str, package: str, roots: set[str]) -> str:
    if isinstance(node, ast.ImportFrom):
        if node.level or (node.module or "").split(".")[0] not in roots:
            return statement
        return re.sub(r"from\s+", f"from {package}.", statement, count=1)
    parts = []
    for alias in node.names:
        root, _, remainder = alias.name.partition(".")
        base, _, last = alias.name.rpartition(".")
        name = f" as {alias.asname}" if alias.asname else ""
        if root not in roots:
            parts.append(f"import {alias.name}{name}")
        elif alias.asname:
            parts.append(f"from {package}{'.' if base else ''}{base} import {last}{name}")
        else:
            # `import a.b` loads a.b, and binds the name a
            parts += [f"import {package}.{alias.name}"] if remainder else []
            parts.append(f"from {package} import {root}")
    return "; ".join(parts)

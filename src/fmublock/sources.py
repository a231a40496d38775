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

_OWN = "fmublock"
_OWN_ROOT = Path(__file__).parents[1]
_ELSEWHERE = {_OWN, *sys.stdlib_module_names}


@dataclass
class Sources:
    """Texts of Python files by path relative to the import root, and the other modules they import.

    `foreign` has the modules that are neither among the files nor in the standard library, by the name
    of the module that imports them.
    """

    texts: dict[str, str] = field(default_factory=dict)
    foreign: dict[str, set[str]] = field(default_factory=dict)

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
        if base.origin.module.split(".")[0] != _OWN:
            files[module_of(base)] = _file_of(base)
    search = _Search(files, follow_own=bool(more))
    gathered = Sources()
    waiting = [*files, *(f"{_OWN}.{name}" for name in more)]
    while waiting:
        module = waiting.pop()
        if "." in module:
            waiting.append(module.rpartition(".")[0])
        file = search.find(module)
        path = "" if file is None else _path_of(module, file)
        if file is None or path in gathered.texts:  # a folder may be a package without a file
            continue
        gathered.texts[path] = _read(file, None if module.split(".")[0] == _OWN else block.origin)
        package = module if file.name == "__init__.py" else module.rpartition(".")[0]
        for name in _list_imports(gathered.texts[path], package, file):
            if search.find(name) is not None:
                waiting.append(name)
            elif search.is_foreign(name):
                gathered.foreign.setdefault(module, set()).add(name.split(".")[0])
    return gathered


def move_into_package(sources: Mapping[str, str], package: str) -> dict[str, str]:
    """Move the files into `package` and rewrite their imports of each other.

    Without this, two FMUs in one process could run each other's modules, or the installed ones.
    """
    roots = {path.split("/")[0].removesuffix(".py") for path in sources}
    moved = {f"{package}/{path}": _rewrite_imports(text, package, roots) for path, text in sources.items()}
    return {f"{package}/__init__.py": "", **moved}


class _Search:
    """Finds the modules that belong to a block, by name."""

    def __init__(self, files: Mapping[str, Path], follow_own: bool) -> None:
        self._files = files
        self._roots: dict[str, Path] = {_OWN: _OWN_ROOT} if follow_own else {}
        self._beside: list[Path] = []
        installed = {Path(sysconfig.get_path(name)) for name in ("purelib", "platlib")}
        for module, file in files.items():
            if "." in module:
                self._roots[module.split(".")[0]] = file.parents[module.count(".")]
            elif file.parent not in installed:
                self._beside.append(file.parent)

    def find(self, module: str) -> Path | None:
        """Return the file of a module, if it belongs to the block."""
        if module in self._files:
            return self._files[module]
        top = module.split(".")[0]
        beside = [] if top in _ELSEWHERE else self._beside
        for root in [self._roots[top]] if top in self._roots else beside:
            place = root.joinpath(*module.split("."))
            for file in (place.with_name(f"{place.name}.py"), place / "__init__.py"):
                if file.is_file():
                    return file
        return None

    def is_foreign(self, name: str) -> bool:
        """Return whether a name that is not a file of the block is a foreign module."""
        top = name.split(".")[0]
        return top not in _ELSEWHERE and self.find(top) is None


def _file_of(block: type[Block]) -> Path:
    file = None if block.origin.file is None else Path(block.origin.file)
    if file is None or not file.is_file() or block.__qualname__ not in _classes(_read(file, block.origin)):
        raise BuildError(
            f"{block.__name__} is not defined at the top of a Python file, whose text could go into an FMU."
        )
    return file


def _path_of(module: str, file: Path) -> str:
    return module.replace(".", "/") + ("/__init__.py" if file.name == "__init__.py" else ".py")


def _read(file: Path, origin: Origin | None) -> str:
    """Read a file, which must not have changed since the block's origin, if there is one."""
    if origin is not None and file.stat().st_mtime > origin.time:
        raise BuildError(
            f"'{file}' has changed since {origin.module} was imported; import it again, in a new process."
        )
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise BuildError(f"'{file}' is not encoded as UTF-8.") from None


def _list_imports(text: str, package: str, file: Path) -> Iterator[str]:
    """Yield the names of modules that a text imports; for `from a import b` both a and a.b."""
    try:
        statements = _import_statements(text)
    except SyntaxError as error:
        raise BuildError(f"'{file}' is not valid Python: {error.msg} in line {error.lineno}.") from None
    for level, base, names in statements:
        if level < 0:
            yield from names
            continue
        base = importlib.util.resolve_name("." * level + base, package) if level else base
        yield base
        yield from (f"{base}.{name}" for name in names)


@cache
def _classes(text: str) -> frozenset[str]:
    """Return the names of the classes at the top of a text; none if it is not valid Python."""
    try:
        body = ast.parse(text).body
    except SyntaxError:
        return frozenset()
    return frozenset(node.name for node in body if isinstance(node, ast.ClassDef))


@cache
def _import_statements(text: str) -> Sequence[tuple[int, str, tuple[str, ...]]]:
    """Return the imports of a text: dots before the module (-1 for `import a`), module, and names."""
    found = []
    for node in _nodes(ast.parse(text)):
        names = tuple(alias.name for alias in getattr(node, "names", ()) if isinstance(alias, ast.alias))
        if isinstance(node, ast.ImportFrom):
            found.append((node.level, node.module or "", names))
        elif isinstance(node, ast.Import):
            found.append((-1, "", names))
    return found


def _nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements except those that only type checkers see."""
    yield tree
    for child in ast.iter_child_nodes(tree):
        if not isinstance(child, (ast.stmt, ast.excepthandler, ast.match_case)):
            continue
        if isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING"):
            for other in child.orelse:
                yield from _nodes(other)
        else:
            yield from _nodes(child)


def _rewrite_imports(text: str, package: str, roots: set[str]) -> str:
    """Rewrite absolute imports of `roots` to imports from inside `package`."""
    lines = text.encode().splitlines(keepends=True)
    nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]
    for node in sorted(nodes, key=lambda n: (n.lineno, n.col_offset), reverse=True):
        start, end = node.lineno - 1, (node.end_lineno or node.lineno) - 1
        before, after = lines[start][: node.col_offset], lines[end][node.end_col_offset :]
        statement = b"".join(lines[start : end + 1])[node.col_offset :]
        statement = statement[: len(statement) - len(after)].decode()
        new = _rewritten_import(node, statement, package, roots)
        lines[start : end + 1] = (before + new.encode() + after).splitlines(keepends=True)
    return b"".join(lines).decode()


def _rewritten_import(
    node: ast.Import | ast.ImportFrom, statement: str, package: str, roots: set[str]
) -> str:
    if isinstance(node, ast.ImportFrom):
        if node.level or (node.module or "").split(".")[0] not in roots:
            return statement
        return re.sub(r"from\s+", f"from {package}.", statement, count=1)
    parts = []
    for alias in node.names:
        root, _, rest = alias.name.partition(".")
        base, _, last = alias.name.rpartition(".")
        name = f" as {alias.asname}" if alias.asname else ""
        if root not in roots:
            parts.append(f"import {alias.name}{name}")
        elif alias.asname:
            parts.append(f"from {package}{'.' if base else ''}{base} import {last}{name}")
        else:
            parts += [f"import {package}.{alias.name}"] if rest else []
            parts.append(f"from {package} import {root}")
    return "; ".join(parts)

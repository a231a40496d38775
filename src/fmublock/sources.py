"""The Python files that a block needs, gathered so that they can run from inside an FMU."""

import ast
import importlib.util
import re
import sys
from pathlib import Path

from .block import Block
from .export import BuildError


def gather_sources(modules: list[str]) -> dict[str, str]:
    """Texts of these modules and of all that they import, by path relative to the import root.

    Raises BuildError for an import that is neither of the standard library nor of one of the
    packages of `modules`: an FMU's host need not have anything else.
    """
    packages = {module.split(".")[0] for module in modules}
    waiting, gathered = list(modules), dict[str, str]()
    while waiting:
        module = waiting.pop()
        path, text = _read(module)
        if path in gathered:
            continue
        gathered[path] = text
        if "." in module:
            waiting.append(module.rpartition(".")[0])
        waiting += _imports(module, path, text, packages)
    return gathered


def move_into_package(sources: dict[str, str], package: str) -> dict[str, str]:
    """The same files inside `package`, with their imports of each other rewritten.

    Two FMUs in one process then never run each other's modules, nor the installed ones.
    """
    roots = sorted({path.split("/")[0].removesuffix(".py") for path in sources})
    absolute = re.compile(rf"^(\s*from )({'|'.join(roots)})(?=[. ])", re.MULTILINE)
    moved = {f"{package}/{path}": absolute.sub(rf"\1{package}.\2", text) for path, text in sources.items()}
    return {f"{package}/__init__.py": "", **moved}


def block_modules(block: Block) -> list[str]:
    """The modules that define the block and the blocks it derives from."""
    return [base.__module__ for base in type(block).__mro__ if issubclass(base, Block)]


def _read(module: str) -> tuple[str, str]:
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        raise BuildError(f"the source of the module {module} cannot be found.")
    file = Path(spec.origin)
    relative = module.replace(".", "/") + ("/__init__.py" if file.name == "__init__.py" else ".py")
    return relative, file.read_text(encoding="utf-8")


def _imports(module: str, path: str, text: str, packages: set[str]) -> list[str]:
    """Modules of `packages` that this text imports."""
    package = module if path.endswith("/__init__.py") else module.rpartition(".")[0]
    found: list[str] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            candidates = [f"{base}.{alias.name}" for alias in node.names]
            names = [c for c in candidates if base.split(".")[0] in packages and _exists(c)] or [base]
            found += [base, *names]
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
    inside = [name for name in found if name.split(".")[0] in packages]
    foreign = {name for name in found if name.split(".")[0] not in packages | set(sys.stdlib_module_names)}
    if foreign:
        raise BuildError(
            f"{module} imports {', '.join(sorted(foreign))}; a block may import the standard library only."
        )
    return inside


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False

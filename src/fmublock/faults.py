"""Error messages that name the place in a block's text at which its equations fail."""

import ast
import linecache
import sys
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from types import CodeType, TracebackType
from typing import Any, NamedTuple

from .block import Block
from .errors import BuildError
from .results import EquationError
from .symbol import RefusedError

_PACKAGE_FOLDER = str(Path(__file__).parent)


class _SourcePosition(NamedTuple):
    """A part of a line that was being executed."""

    file: str
    line: int
    column: int
    text: str


def equation_fault(block: Block, method: str, error: BaseException) -> BuildError:
    """Convert an exception in a block's method to a message with block, method, results, line, expression."""
    if isinstance(error, EquationError):
        return BuildError(str(error))
    linecache.checkcache()  # files may have changed since other faults
    name = f"{type(block).__name__}.{method}"
    function = getattr(type(block), method)
    positions = list(_find_positions(block, function, error.__traceback__))
    if not positions:
        return BuildError(f"{name} cannot be evaluated: {_summarize(error)}.")
    first, last = positions[0], positions[-1]
    results = _find_affected_results(function, first)
    subject = f"{name}, {' and '.join(results)}" if results else name
    where = f"`{last.text}` in line {last.line} of {Path(last.file).name}"
    if isinstance(error, RefusedError):
        return BuildError(f"{subject}: {where} {error}.")
    return BuildError(f"{subject}: {where} fails: {_summarize(error)}.")


def result_line(block: Block, method: str, result: str) -> str:
    """Return where a method returns a result, such as ` in line 7 of mine.py`; empty if unknown."""
    function = getattr(type(block), method)
    for node in ast.walk(_find_definition(function) or ast.Module([], [])):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == result:
                    return f" in line {value.lineno} of {Path(function.__code__.co_filename).name}"
    return ""


def _summarize(error: BaseException) -> str:
    text = str(error).splitlines()
    return f"{type(error).__name__}: {text[0].rstrip('.')}" if text else type(error).__name__


def _find_positions(
    block: Block, function: Any, traceback: TracebackType | None
) -> Iterator[_SourcePosition]:
    """Yield the places of a traceback in the user's files, from the method inwards."""
    # positions inside of fmublock or the standard library do not help the user
    files = {base.origin.file for base in type(block).__mro__ if issubclass(base, Block)}
    folders = {str(Path(file).parent) for file in files if file is not None} - {_PACKAGE_FOLDER}
    code, is_inside = getattr(function, "__code__", None), False
    while traceback is not None:
        executed = traceback.tb_frame.f_code
        is_inside = is_inside or executed is code
        is_same_file = executed.co_filename == getattr(code, "co_filename", None)
        is_in_folder = str(Path(executed.co_filename).parent) in folders
        if is_inside and (is_same_file or is_in_folder):
            yield _read_position(executed, traceback)
        traceback = traceback.tb_next


def _read_position(code: CodeType, traceback: TracebackType) -> _SourcePosition:
    position = next(islice(code.co_positions(), traceback.tb_lasti // 2, None))
    line, end_line, column, end_column = position
    if line is None:
        line = traceback.tb_lineno
    text = linecache.getline(code.co_filename, line)
    if line == end_line and column is not None:
        text = text.encode()[column:end_column].decode()
    return _SourcePosition(code.co_filename, line, column or 0, text.strip() or "...")


def _find_definition(function: Callable[..., Any]) -> ast.FunctionDef | None:
    """Parse the text of a function; None if there is no text."""
    code = getattr(function, "__code__", None)
    if code is None:
        return None
    try:
        tree = ast.parse("".join(linecache.getlines(code.co_filename)))
    except SyntaxError:
        return None
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name == code.co_name:
            first = min(n.lineno for n in (node, *node.decorator_list))
            if first == code.co_firstlineno:
                return node
    return None


def _find_affected_results(function: Callable[..., Any], position: _SourcePosition) -> list[str]:
    """Return the keys of the returned dict whose values depend on this place, judged by names."""
    definition = _find_definition(function)
    names: set[str] = set()
    results: list[str] = []
    if definition is None:
        return results

    conditional: set[ast.AST] = set()  # statements under a concerned condition

    def is_affected(node: ast.AST) -> bool:
        used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        return _covers(node, position) or node in conditional or bool(used & names)

    statements = [n for n in ast.walk(definition) if isinstance(n, ast.stmt)]
    for statement in sorted(statements, key=lambda s: s.lineno):
        match statement:
            case ast.Assign(targets=targets, value=value) if is_affected(value):
                names |= _assigned_names(targets)
            case ast.AugAssign(target=target, value=value) if is_affected(value):
                names |= _assigned_names([target])
            case ast.If(test=value) | ast.While(test=value) | ast.For(iter=value) if (
                is_affected(value) or (statement.lineno, statement.col_offset) == position[1:3]
            ):
                conditional |= set(ast.walk(statement))
            case ast.Return(value=ast.Dict(keys=keys, values=values)):
                pairs = zip(keys, values, strict=True)
                results += [str(k.value) for k, v in pairs if isinstance(k, ast.Constant) and is_affected(v)]
    return results


def _assigned_names(targets: list[ast.expr]) -> set[str]:
    """Return the names that an assignment changes."""
    return {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}


def _covers(node: ast.AST, position: _SourcePosition) -> bool:
    start = getattr(node, "lineno", sys.maxsize), getattr(node, "col_offset", 0)
    end = getattr(node, "end_lineno", 0), getattr(node, "end_col_offset", 0)
    return start <= (position.line, position.column) < end

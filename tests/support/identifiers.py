"""Names in the code that say nothing about their content, and prose in docstrings, comments and messages."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.support.language import check_text
from tests.support.paths import ROOT

FOLDERS = ("src", "orchestration", "tests")

VAGUE = {
    "found": "name the content: matches, problems, trajectory",
    "one": "name the element: variable, component, row",
    "place|places": "path, index, position, slot",
    "given": "overrides, requested, arguments",
    "known": "allowed, existing, options",
    "own": "declared, local",
    "shown": "labels, displayed, recorded_signals",
    "what": "subject, description",
    "said": "message, text",
    "wanted": "expected, requested",
    "whole": "total, full_step",
    "kept": "remaining, retained",
    "chosen": "the noun of what was selected",
    "every": "the noun in the plural, steps_per_row",
    "asked": "requested",
    "told": "reported, message",
    "theirs|mine": "replacement, selected",
    "taken": "used, accepted, samples",
    "named": "the noun: names, listed",
    "again": "second_run, after_reset",
    "beside": "overhead, neighbours",
    "judged": "compared, is_controlled",
    "meant": "suggestions, advice",
}
"""Names of variables, arguments, functions and attributes, each with what to write instead."""

_LEFT_OUT = (
    *("longer", "more", "less", "fewer", "later", "earlier", "larger", "smaller"),
    *("such", "need", "time", "space", "room", "one", "other"),
)
_NO_NOUN = re.compile(rf"(?<!here )\b(?:is|are) no (?!{'|'.join(_LEFT_OUT)})[a-z]+\b")


@cache
def list_vague_names() -> dict[str, list[str]]:
    """Return the definitions of vague names, as `file:line: name`, for each entry of `VAGUE`."""
    entries = {word: words for words in VAGUE for word in words.split("|")}
    definitions: dict[str, list[str]] = {words: [] for words in VAGUE}
    for path in _list_files(FOLDERS):
        for name, line in _definitions(_parse(path)):
            if (words := entries.get(name.strip("_"))) is not None:
                definitions[words].append(f"{path.relative_to(ROOT)}:{line}: {name}")
    return definitions


def find_faults_of_prose(*folders: str) -> list[str]:
    """Return banned words in docstrings, comments and messages of these folders."""
    faults = list[str]()
    for path in _list_files(folders):
        name = str(path.relative_to(ROOT))
        for line, text in _passages(path):
            faults += check_text(text, name, line, with_length=False)
            plain = re.sub(r"`[^`]*`", "", text)
            faults += [f"{name}:{line}: '{m[0]}': write 'is not a ...'" for m in _NO_NOUN.finditer(plain)]
    return faults


def _list_files(folders: tuple[str, ...]) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


@cache
def _parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _definitions(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield names that are bound, and their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name, node.lineno


def _passages(path: Path) -> Iterator[tuple[int, str]]:
    """Yield strings with more than one word, and comments, with their lines."""
    for node in ast.walk(_parse(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value
    with io.StringIO(path.read_text(encoding="utf-8")) as stream:
        for token in tokenize.generate_tokens(stream.readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string

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
    for path, _, tree in _parse(*FOLDERS):
        for name, line in _definitions(tree):
            if (words := entries.get(name.strip("_"))) is not None:
                definitions[words].append(f"{path.relative_to(ROOT)}:{line}: {name}")
    return definitions


def find_faults_of_prose(*folders: str) -> list[str]:
    """Return banned words in docstrings, comments and messages of these folders."""
    faults = list[str]()
    for path, text, tree in _parse(*folders):
        name = str(path.relative_to(ROOT))
        for line, passage in [*_strings(tree), *_comments(text)]:
            faults += _check_passage(passage, name, line)
    return faults


def _check_passage(text: str, name: str, line: int) -> list[str]:
    plain = re.sub(r"`[^`]*`", "", text)
    articles = [f"{name}:{line}: '{m[0]}': write 'is not a ...'" for m in _NO_NOUN.finditer(plain)]
    return check_text(text, name, line, with_length=False) + articles


def _parse(*folders: str) -> Iterator[tuple[Path, str, ast.Module]]:
    """Yield all files below these folders with text and syntax, one by one: many trees slow down Python."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            yield path, text, ast.parse(text)


def _definitions(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield names that are bound, and their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            if isinstance(node.ctx, ast.Store):
                yield node.id, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.Attribute):
            if isinstance(node.ctx, ast.Store):
                yield node.attr, node.lineno
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name, node.lineno


def _strings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield strings with more than one word, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


def _comments(text: str) -> Iterator[tuple[int, str]]:
    """Yield comments with their lines, of a file where something after a # may be a fault."""
    # to find out what is a comment takes longer than to parse, and few files have faults
    if any(_check_passage(line.partition("#")[2], "", 0) for line in text.splitlines() if "#" in line):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string

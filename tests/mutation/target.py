"""What is mutated, and how the mutants are drawn."""

import ast
import random
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cosmic_ray.commands import init
from cosmic_ray.config import ConfigDict
from cosmic_ray.modules import find_modules
from cosmic_ray.work_db import WorkDB
from cosmic_ray.work_item import WorkItem

HERE = Path(__file__).parent

TRIVIAL = re.compile(
    "core/(ReplaceBinaryOperator_.*_(RShift|LShift|BitOr|BitAnd|BitXor)|ReplaceBinaryOperator_BitOr_.*"
    "|ReplaceComparisonOperator_.*_(Is|IsNot)|ReplaceUnaryOperator_.*_Invert)"
)
"""Operators that floats do not have, which any test would notice, and those of annotations."""


@dataclass(frozen=True)
class Target:
    """A table of targets.toml; the fields are explained there."""

    name: str
    modules: list[str]
    tests: str
    declarations: bool
    sample: int
    timeout: float

    @property
    def command(self) -> str:
        """What runs the tests and ends at the first that fails."""
        return f"python -m pytest -x -q -n 0 -p no:cacheprovider {' '.join(self.tests.split())}"

    def draw(self, work: WorkDB, count: int | None, seed: int) -> None:
        """Draw mutants, always the same for the same code and seed; all of them if `count` is 0."""
        init(find_modules([Path(module) for module in self.modules]), work, ConfigDict())
        items = sorted(filter(self._counts, work.work_items), key=_place)
        count = self.sample if count is None else count
        drawn = random.Random(seed).sample(items, len(items))  # so that a larger sample holds a smaller one
        work.clear()
        work.add_work_items(drawn[: count or None])

    def _counts(self, item: WorkItem) -> bool:
        (mutation,) = item.mutations
        if TRIVIAL.fullmatch(mutation.operator_name):
            return False
        return self.declarations or not _declares(mutation.module_path, mutation.start_pos[0])


def configuration(target: Target) -> ConfigDict:
    """The same as the library wants it."""
    return ConfigDict(
        {"test-command": target.command, "timeout": target.timeout, "distributor": {"name": "local"}}
    )


def _place(item: WorkItem) -> tuple[str, tuple[int, int], str, int]:
    (m,) = item.mutations
    return str(m.module_path), m.start_pos, m.operator_name, m.occurrence


def _declares(module: Path, line: int) -> bool:
    """Whether a line is in the body of a class, but in none of its methods."""
    scopes = [node for node in _scopes(module) if node.lineno <= line <= (node.end_lineno or 0)]
    return bool(scopes) and isinstance(max(scopes, key=lambda node: node.lineno), ast.ClassDef)


@cache
def _scopes(module: Path) -> list[ast.ClassDef | ast.FunctionDef]:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, (ast.ClassDef, ast.FunctionDef))]


def _targets() -> Iterator[Target]:
    for name, fields in tomllib.loads((HERE / "targets.toml").read_text(encoding="utf-8")).items():
        yield Target(name, **fields)


TARGETS = {target.name: target for target in _targets()}
"""Targets by name."""

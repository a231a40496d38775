"""Mutants: how they are drawn, and what they change."""

import difflib
import json
import random
import re
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosmic_ray.commands import init
from cosmic_ray.config import ConfigDict
from cosmic_ray.modules import find_modules
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db

FOLDER = Path(__file__).parent
GROUPS: dict[str, dict[str, Any]] = tomllib.loads((FOLDER / "groups.toml").read_text(encoding="utf-8"))

TRIVIAL = re.compile(
    "core/(ReplaceBinaryOperator_.*_(RShift|LShift|BitOr|BitAnd|BitXor)|ReplaceBinaryOperator_BitOr_.*"
    "|ReplaceComparisonOperator_.*_(Is|IsNot)|ReplaceUnaryOperator_.*_Invert)"
)
"""Operators that floats do not have, which any test would notice, and those of annotations."""


@dataclass(frozen=True)
class Mutant:
    """One change of one module: the `occurrence`-th place where an operator of cosmic-ray applies."""

    module: str
    line: int
    operator: str
    occurrence: int

    @property
    def key(self) -> str:
        """A text that identifies it."""
        return f"{self.module}:{self.line}:{self.operator}:{self.occurrence}"

    def apply(self, folder: Path) -> str:
        """Change the module in a copy of the project. Return the difference."""
        path = folder / self.module
        before = path.read_text(encoding="utf-8")
        after = mutate_code(before, get_operator(self.operator)(), self.occurrence)
        assert after is not None, f"{self.key} changes nothing; were the mutants drawn from other sources?"
        path.write_text(after, encoding="utf-8")
        lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
        return "\n".join(line for line in lines if line[:1] in "+-" and line[:3] not in ("---", "+++"))


def draw(seed: int, drawing: Path) -> list[Mutant]:
    """Draw the mutants of all groups, always the same for the same sources and seed.

    Args:
        seed: Of the drawing.
        drawing: A file for the drawing, which takes minutes; if it exists, its mutants are returned.
    """
    if drawing.exists():
        return [Mutant(**fields) for fields in json.loads(drawing.read_text(encoding="utf-8"))]
    mutants = [mutant for group in GROUPS.values() for mutant in _draw_group(group, seed)]
    drawing.parent.mkdir(parents=True, exist_ok=True)
    drawing.write_text(json.dumps([asdict(mutant) for mutant in mutants], indent=1), encoding="utf-8")
    return mutants


def _draw_group(group: dict[str, Any], seed: int) -> list[Mutant]:
    candidates = sorted(_candidates([Path(m) for m in group["modules"]]), key=lambda m: m.key)
    return random.Random(seed).sample(candidates, group["mutants"])


def _candidates(modules: list[Path]) -> Iterator[Mutant]:
    with tempfile.TemporaryDirectory() as folder, use_db(f"{folder}/all.sqlite", WorkDB.Mode.create) as work:
        init(find_modules(modules), work, ConfigDict())
        for item in work.work_items:
            (mutation,) = item.mutations
            line = mutation.start_pos[0]
            if not TRIVIAL.fullmatch(mutation.operator_name):
                yield Mutant(str(mutation.module_path), line, mutation.operator_name, mutation.occurrence)

"""Builds the toy block as an FMU."""

import os
import shutil
from pathlib import Path

from filelock import FileLock

from fmublock import Documents, Producer, build
from fmublock.cache import VARIABLE
from fmublock.recipe import Recipe
from tests.support.toy import Toy

PRODUCER = Producer("test", "1.0", "MIT")
DOCUMENTS = Documents("# Toy\n\n$$\n\\dot x = \\frac{F}{m}\n$$\n", "Do what you want.")


def build_toy(flavour: str, path: Path, fmi: int = 2, clock: float | None = None) -> Path:
    """Build the toy's FMU at this path, with a clock of this interval in s."""
    return build(Toy, path, flavour=flavour, producer=PRODUCER, documents=DOCUMENTS, fmi=fmi, clock=clock)


def copy_toy(path: Path, fmi: int = 2, clock: float | None = None) -> Path:
    """Copy the toy's native FMU to this path. One process builds it, for all others and the next run."""
    key = Recipe.of(Toy, "native", PRODUCER, DOCUMENTS, fmi=fmi, clock=clock).key()
    assert key is not None
    cached = Path(os.environ[VARIABLE], "toys", key, "Toy.fmu")
    cached.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(cached.with_suffix(".lock")):
        if not cached.exists():
            build_toy("native", cached, fmi, clock)
    shutil.copyfile(cached, path)
    return path

"""Builds the toy block as an FMU."""

from pathlib import Path

from fmublock import Documents, Producer, build
from tests.support.toy import Toy

PRODUCER = Producer("test", "1.0", "MIT")
DOCUMENTS = Documents("# Toy\n\n$$\n\\dot x = \\frac{F}{m}\n$$\n", "Do what you want.")


def build_toy(flavour: str, path: Path, fmi: int = 2, clock: float | None = None) -> Path:
    """Build the toy's FMU at this path, with a clock of this interval in s."""
    return build(Toy, path, flavour=flavour, producer=PRODUCER, documents=DOCUMENTS, fmi=fmi, clock=clock)

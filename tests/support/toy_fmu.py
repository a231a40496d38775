"""Builds the toy block as an FMU."""

from pathlib import Path

from fmublock.description import Producer
from fmublock.export import Documents
from fmublock.native import build_native, host_platform, native_draft
from fmublock.python_flavour import build_python, python_draft
from tests.support.toy import Toy

PRODUCER = Producer("test", "1.0", "MIT")
DOCUMENTS = Documents("# Toy\n\n$$\n\\dot x = \\frac{F}{m}\n$$\n", "Do what you want.")


def build_toy(flavour: str, path: Path) -> Path:
    """Build the toy's FMU at this path."""
    if flavour == "native":
        build_native(native_draft(Toy(), PRODUCER, DOCUMENTS), [host_platform()], path)
    else:
        build_python(python_draft(Toy(), PRODUCER, DOCUMENTS), path)
    return path

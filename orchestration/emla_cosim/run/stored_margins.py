"""Stability margins that `emla linearize` has stored, for the report of a run."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..base.files import read_text

RECORD = "linearize.json"


def read_margins(folder: Path) -> dict[str, Any]:
    """Return scenario, time and the margins of each loop, from an output folder of `emla linearize`.

    Args:
        folder: The folder, or the file `linearize.json`.

    Raises:
        CommandError: The file cannot be read, or has no margins.
    """
    file = folder / RECORD if folder.is_dir() else folder
    try:
        found = json.loads(read_text(file, "the margins"))
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, Mapping) or found.get("format") != "emla-linearization":
        raise CommandError(f"'{file}' is no linearization; name an output folder of emla linearize.")
    loops = {name: of["margins"] for name, of in found.get("responses", {}).items() if of["margins"]}
    if not loops:
        raise CommandError(f"'{file}' has no margins; emla linearize computes them with --open.")
    return {"scenario": found["scenario"], "at_s": found["at_s"], "loops": loops}

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
    entries = found.get("responses")
    responses = entries if isinstance(entries, Mapping) else {}
    loops = {
        name: of["margins"] for name, of in responses.items() if isinstance(of, Mapping) and of.get("margins")
    }
    if not loops:
        raise CommandError(f"'{file}' has no margins; emla linearize computes them with --open.")
    scenario, at = found.get("scenario"), found.get("at_s")
    if not (isinstance(scenario, str) and _is_number(at) and all(map(_are_margins, loops.values()))):
        raise CommandError(f"'{file}' is damaged; make it anew with emla linearize.")
    return {"scenario": scenario, "at_s": at, "loops": loops}


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _are_margins(found: object) -> bool:
    """Return whether an entry has numbers by name; None is one that does not exist."""
    return isinstance(found, Mapping) and all(x is None or _is_number(x) for x in found.values())

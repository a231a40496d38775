"""Stability margins that `emla linearize` has stored, for the report of a run."""

from pathlib import Path
from typing import Any, Literal

import msgspec

from ..base.errors import CommandError
from ..base.files import read_text

RECORD = "linearize.json"


class _Response(msgspec.Struct):
    margins: dict[str, float | None] | None = None


class _Linearization(msgspec.Struct):
    format: Literal["emla-linearization"]
    scenario: str
    at_s: float
    responses: dict[str, _Response] = {}


def read_margins(folder: Path) -> dict[str, Any]:
    """Return scenario, time and the margins of each loop, from an output folder of `emla linearize`.

    Args:
        folder: The folder, or the file `linearize.json`.

    Raises:
        CommandError: The file cannot be read, or has no margins.
    """
    file = folder / RECORD if folder.is_dir() else folder
    text = read_text(file, "the margins")
    try:
        record = msgspec.json.decode(text, type=_Linearization)
    except (msgspec.DecodeError, RecursionError) as error:
        raise CommandError(
            f"'{file}' is not a linearization result; pass an output folder of `emla linearize`."
        ) from error
    loops = {name: response.margins for name, response in record.responses.items() if response.margins}
    if not loops:
        raise CommandError(f"'{file}' has no margins; emla linearize computes them with --open.")
    return {"scenario": record.scenario, "at_s": record.at_s, "loops": loops}

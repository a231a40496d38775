"""Processes without what a wheel brings, which an editable installation does not have."""

import os
from pathlib import Path

_CODE = """
from pathlib import Path

import fmublock.cache

fmublock.cache.PREBUILT = Path("nothing")
"""


def without_prebuilt(folder: Path) -> dict[str, str]:
    """Return environment variables of processes that build what they need; `folder` gets a file for this."""
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(_CODE)
    path = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {"PYTHONPATH": os.pathsep.join(path)}

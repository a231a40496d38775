"""Other names of `hand_written_fmus`, for a while."""

from pathlib import Path
from typing import Any

import fmpy

from tests.support import hand_written_fmus
from tests.support.hand_written_fmus import *  # noqa: F403
from tests.support.hand_written_fmus import TOYS, compile_library  # noqa: F401

_OLD = {
    "fmi3": "all_types_3",
    "integrated": "integrated",
    "integrated3": "integrated_3",
    "state_space": "state_space",
    "all_types": "all_types",
}


def build_handwritten_fmu(
    path: Path, source: Path, placeholders: Any = None, macros: Any = None, platform: str = fmpy.platform
) -> Path:
    name = _OLD.get(source.parent.name)
    if name is None:
        return hand_written_fmus.build_handwritten_fmu(path, source, placeholders, macros, platform)
    more = (
        {"FMI": 3} if name == "integrated_3" else {"FMI": 2, "INDICATORS": 1} if name == "integrated" else {}
    )
    c = "integrated.c" if name == "integrated_3" else f"{name}.c"
    return hand_written_fmus.build_handwritten_fmu(
        path, TOYS / c, placeholders, {**(macros or {}), **more}, platform, TOYS / f"{name}.xml"
    )

"""Systems of blocks, each built as an FMU of its own."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import fmublock
from emla_cosim import System
from fmublock import Block


def built(folder: Path, blocks: Mapping[str, type[Block]], wires: Sequence[str]) -> System:
    """Return a system of native FMUs, one per component, built in this folder where they are missing.

    Args:
        folder: Folder of the FMUs.
        blocks: Blocks by the names of their components.
        wires: Connections, each "component.output -> component.input".

    """
    files = {name: folder / f"{block.__name__}.fmu" for name, block in blocks.items()}
    for name, file in files.items():
        if not file.exists():
            fmublock.build(blocks[name], file)
    return System.of({name: str(file) for name, file in files.items()}, wires)

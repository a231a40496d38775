"""Descriptions as JSON, and as Python files whose blocks are like all others."""

from pathlib import Path

import pytest

from emla_cosim.study.machines.schema import list_machine_names, load_machine
from fmublock import Instance, load_block
from fmublock.recipe import Recipe
from fmublock.sources import gather_sources
from machine_fmu import MachineError, read_definition, write_definition, write_module


@pytest.mark.parametrize("name", list_machine_names())
def test_definition_is_the_machine(name: str) -> None:
    machine = load_machine(name)
    assert read_definition(write_definition(machine)) == machine


@pytest.mark.parametrize("text", ["", "{", "[]", "{}"])
def test_other_texts(text: str) -> None:
    with pytest.raises(MachineError, match="the definition of the machine cannot be read"):
        read_definition(text)


def test_file_with_blocks(tmp_path: Path) -> None:
    """The cache of FMUs knows its text, and it needs nothing that a PythonFMU FMU cannot contain."""
    file = tmp_path / "crane_blocks.py"
    file.write_text(write_module(load_machine("crane"), "crane", "CraneLoad", "CranePlant"), encoding="utf-8")
    block = load_block(f"{file}:CraneLoad")
    assert block.__name__ == "CraneLoad"
    assert Instance(block())["F_L"][0] > 0.0
    gathered = gather_sources(block)
    assert "crane_blocks.py" in gathered.texts
    assert not gathered.foreign
    assert Recipe.of(block, "python").key() is not None

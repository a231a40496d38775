"""Machine files: what they contain, and messages for wrong ones."""

import re
import tomllib
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.study.machines.machine_info import collect_machine
from emla_cosim.study.machines.schema import (
    ActuatorTable,
    BodyTable,
    LinkTable,
    MachineTable,
    MotionTable,
    PayloadTable,
    list_machine_names,
    load_machine,
    parse_machine,
)
from tests.support.paths import ROOT

LIFT = """
kind = "machine"
description = "A boom"
dimensions = 2
ground.points.foot = [0.4, "-500 mm"]

[bodies.boom]
joint = "revolute"
assembly = "30 deg"
m = "120 kg"
c = [1.0, 0.0]
J = 30.0
points = { pin = [0.6, 0.1] }

[actuators.lift]
from = "ground.foot"
to = "boom.pin"
length = 0.5
stroke = [0.0, 0.4]
"""


def message(old: str, new: str) -> str:
    assert old in LIFT
    with pytest.raises(CommandError) as error:
        parse_machine(tomllib.loads(LIFT.replace(old, new)), "the machine 'boom.toml'")
    return str(error.value)


def test_short_file() -> None:
    machine = parse_machine(tomllib.loads(LIFT), "the machine", Path())
    assert machine.ground["foot"].position == (0.4, -0.5)
    assert machine.bodies["boom"].m == 120.0
    assert machine.actuators["lift"].stroke == (0.0, 0.4)


def test_machines_of_the_study() -> None:
    assert list_machine_names() == ["crane", "excavator", "hdrm", "lift_table", "stewart"]
    for name in list_machine_names():
        assert load_machine(name).actuators


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('joint = "revolute"', 'joint = "hinge"', "'joint' in [bodies.boom] of the machine 'boom.toml' is"),
        ('m = "120 kg"', 'm = "120 m"', "'m' in [bodies.boom] of the machine 'boom.toml'"),
        ('m = "120 kg"', 'm = "boom.mass"', "there is no parameter 'boom.mass'; existing: none."),
        ("length = 0.5", "lenght = 0.5", "has the unknown entry 'lenght'; did you mean 'length'?"),
        ('to = "boom.pin"', 'to = "boom.pins"', "there is no point 'pins' of 'boom'; existing: pin."),
        ("c = [1.0, 0.0]", "c = [1.0]", "is [1.0]; it must have 2 or 3 numbers."),
        ("c = [1.0, 0.0]", "c = [1, 0, 0]", "has 3 numbers; with dimensions = 2, it must have 2."),
        ("[0.4, ", "[0.4, 1.0, 1.0, ", "it must be a list of 2 or 3 numbers."),
        ("[0.6, 0.1]", "[0.6, 0.1, 0.0]", "'pin' in [bodies.boom.points] of the machine 'boom.toml' has 3"),
        ("J = 30.0", "J = [1, 1, 30]", "'J' in [bodies.boom] of the machine 'boom.toml' has 3 numbers"),
        ("J = 30.0", "J = -30", "'J' in [bodies.boom] of the machine 'boom.toml' is -30 kg.m2"),
        ('m = "120 kg"', 'm = "-120 kg"', "'m' in [bodies.boom] of the machine 'boom.toml' is '-120 kg'"),
        ("dimensions = 2", "dimensions = 2\ngravity = -9.81", "is -9.81; it must be at least 0."),
        ('assembly = "30 deg"', 'assembly = "30 kg"', "is '30 kg'; it must be an angle or a length"),
        ('assembly = "30 deg"', "axis = [0, 1, 0]", "in the plane, slides move in x and y"),
        ('assembly = "30 deg"', 'axis = ["a", 1, 0]', "'axis' in [bodies.boom] of the machine 'boom.toml'"),
        ('assembly = "30 deg"', 'on = "bom"', "there is no parent 'bom' of the body 'boom'; existing: gro"),
        ("actuators.lift", 'actuators."li.ft"', "of the machine 'boom.toml' has the name 'li.ft'; use"),
        ("bodies.boom", 'bodies."größe"', "has the name 'größe'; use letters"),
        ("[0.6, 0.1]", "{ position = [1, 1], from = 'pin' }", "'pin' of 'boom' counts from itself."),
        ("[0.6, 0.1]", "{ position = [1, 1], from = 'pim' }", "no point 'pim' of 'boom'; existing: pin."),
        ("bodies.boom", "bodies.payload", "[bodies.payload] of the machine 'boom.toml' has a reserved name"),
        ("{ pin =", "{ c = [1, 1], pin =", "two numbers have the name 'boom.c.x'"),
        ("stroke = [0.0, 0.4]", "stroke = [0.4, 0.0]", "is 0.4 to 0 m; write the lowest first."),
        ("stroke = [0.0, 0.4]", "stroke = 0.4\nstart = 0.5", "is 0.5 m, outside its stroke of 0 to 0.4 m."),
        ("stroke = [0.0, 0.4]", "stroke = 3\nstart = 2", "no pose of 'boom' has 'lift' 2.5 m long; its ends"),
        ("stroke = [0.0, 0.4]", "stroke = 0.4\nrod_share = 2", "is 2; it must be at most 1."),
        (
            'm = "120 kg"',
            'm = "m_1"\n[parameters.m_1]\nvalue = 2\nmaximum = 1\n[bodies.more]\njoint = "fixed"',
            "'value' in [parameters.m_1] of the machine 'boom.toml' is 2; that table requires at most 1.",
        ),
    ],
)
def test_wrong_entries(old: str, new: str, expected: str) -> None:
    assert expected in message(old, new)


def test_wrong_inertias_in_space_are_refused() -> None:
    content = tomllib.loads(
        LIFT.replace("dimensions = 2", "dimensions = 3")
        .replace("points = { pin = [0.6, 0.1] }", "points = { pin = [0.6, 0.1, 0.0] }")
        .replace('[0.4, "-500 mm"]', "[0.4, -0.5, 0.0]")
        .replace("[1.0, 0.0]", "[1.0, 0.0, 0.0]")
    )
    for J, expected in (
        ([30.0], "of the machine has 1 number; with dimensions = 3, it must have 3 or 6."),
        ([1.0, 1.0, 30.0], "is 30 kg.m2 about one axis, more than about both others together"),
    ):
        content["bodies"]["boom"]["J"] = J
        with pytest.raises(CommandError, match=re.escape(expected)):
            parse_machine(content, "the machine")


def test_actuator_that_holds_nothing() -> None:
    content = tomllib.loads(LIFT.replace("dimensions = 2", "dimensions = 2\ngravity = 0.0"))
    (lift,) = collect_machine(parse_machine(content, "the machine")).actuators
    assert [str(x) for x in (lift.start_force, lift.lowest_force, lift.highest_force)] == ["0.0"] * 3


def test_documentation_has_all_keys() -> None:
    page = (ROOT / "docs/machines.md").read_text(encoding="utf-8")
    keys = {
        key
        for table in (MachineTable, BodyTable, ActuatorTable, LinkTable, PayloadTable, MotionTable)
        for key in table.__struct_encode_fields__
    }
    entries = page[page.index("## All entries") : page.index("## How lengths give a pose")]
    assert [key for key in sorted(keys) if not re.search(rf"[`\[{{ .]{key}[`\].,}} ]", entries)] == []

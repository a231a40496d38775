"""`emla schema`: the schemas describe what the readers take, as an independent validator sees it."""

import copy
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from emla_cosim.analyses.trajectory.problem import load_problem
from emla_cosim.base.errors import CommandError
from emla_cosim.base.toml_structs import make_schema
from emla_cosim.base.values import convert_value
from emla_cosim.cli.commands.schema import FILE_KINDS
from emla_cosim.run.scenarios.scenario_file import PLANS, SCENARIOS, TUNINGS
from tests.support.commands import Emla, sentence
from tests.support.paths import ROOT


def find_kind(content: Mapping[str, Any], page: str = "") -> str:
    """Return the kind of a file by its entries; empty for a part of a file."""
    if content.get("kind") == "joint":
        return "joint" if "actuator" in content else ""
    if content.get("kind") == "machine":
        return "machine" if "bodies" in content or "urdf" in content else ""
    if "vary" in content:
        return {"identify.md": "identify", "tune.md": "tune"}.get(page, "sweep")
    by_key = {"system": "scenario", "motor": "actuator", "made_by": "reference", "t_M": "trajectory"}
    return next((kind for key, kind in by_key.items() if key in content), "")


def list_documents() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield name, kind and content of all files that come with the project, and of those in the pages."""
    for name, text in (SCENARIOS | PLANS).items():
        content = tomllib.loads(text())
        yield name, find_kind(content), content
    for name in ("rsba-tilt", "foc-lift"):
        yield name, "tune", tomllib.loads(TUNINGS[name]())
    for path in (*(ROOT / "docs").glob("*.toml"), ROOT / "tests/own_machine/actuator.toml"):
        yield path.name, "actuator", tomllib.loads(path.read_text(encoding="utf-8"))
    for path in (ROOT / "fmus").glob("*/*_ref.toml"):
        yield path.name, "reference", tomllib.loads(path.read_text(encoding="utf-8"))
    for page in (ROOT / "docs").glob("*.md"):
        for block in re.findall(r"^```toml[^\n]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S):
            content = tomllib.loads(block)
            if kind := find_kind(content, page.name):
                yield page.name, kind, content


DOCUMENTS = sorted(list_documents(), key=lambda document: document[:2])


@cache
def validator(kind: str) -> Draft7Validator:
    schema = make_schema(FILE_KINDS[kind].struct(), kind)
    Draft7Validator.check_schema(schema)
    return Draft7Validator(schema)


def refusal(kind: str, content: Mapping[str, Any]) -> str:
    """Return the message with which the reader refuses a file; empty if it takes the file."""
    try:
        if kind == "trajectory":
            load_problem(content)
        else:
            convert_value(content, FILE_KINDS[kind].struct(), "the file", Path())
    except CommandError as error:
        return str(error)
    return ""


def test_every_document_is_taken_by_reader_and_schema() -> None:
    assert {kind for _, kind, _ in DOCUMENTS} == set(FILE_KINDS)
    for name, kind, content in DOCUMENTS:
        faults = [
            f"{name}: {error.json_path} {error.message}" for error in validator(kind).iter_errors(content)
        ]
        assert not faults and not refusal(kind, content)


RULES = (  # of the reader, between entries, which a schema does not express
    r"lacks \w+ or \w+",
    r"needs L, or both",
    r"has neither v_peak nor duration",
    r"cannot be read: No such file",
    r"has 0 values of level",
    r"they must be 2 to",
    r"levels and \d times in start",
    r"has a period that is",
    r"is (more|less) than",
    r"the lift triangle cannot close",
    r"cannot be used: too large or too small",
    r"has \d numbers; it must have",
    r"it must be a list of \d",
    r"has neither position nor polar",
)


def list_paths(content: Any) -> list[tuple[str, ...]]:
    if not isinstance(content, dict):
        return []
    return [(key, *path) for key, value in content.items() for path in [(), *list_paths(value)]]


@given(st.data())
def test_changed_document_is_refused_by_both(data: st.DataObject) -> None:
    _, kind, content = data.draw(st.sampled_from(DOCUMENTS))
    content = copy.deepcopy(content)
    *tables, key = data.draw(st.sampled_from(list_paths(content)))
    table = content
    for name in tables:
        table = table[name]
    change = data.draw(st.sampled_from(["drop", "rename", True, "text", [], 3]))
    value = table.pop(key)
    if change == "rename":
        table[f"{key}_x"] = value
    elif change != "drop":
        table[key] = change
    message = refusal(kind, content)
    if not any(re.search(rule, message) for rule in RULES):
        assert validator(kind).is_valid(content) == (not message), message


@pytest.mark.parametrize(
    ("kind", "content", "fault"),
    [
        ("joint", {"start": {"x_L": "abc"}}, "'abc' does not match"),
        ("joint", {"disturbance": {"d_2": {"lov": 1.0}}}, "'lov' was unexpected"),
        ("joint", {"load": {"level": [1.0, "3 kN", True]}}, "True is not of type 'number', 'string'"),
        ("actuator", {"screw": {"ends": "free"}}, "'free' is not one of"),
        ("scenario", {"stop_time": "1 s", "flavour": "rust"}, "'rust' is not one of"),
        ("scenario", {"replace": {"lift.plant": {"fmv": "a.fmu"}}}, "is not valid under any"),
    ],
)
def test_schema_checks_quantities_names_and_choices(kind: str, content: dict[str, Any], fault: str) -> None:
    messages = [error.message for error in validator(kind).iter_errors(content)]
    assert any(fault in message for message in messages), messages


def test_command_prints_the_same_schema_each_time(emla: Emla) -> None:
    first = emla("schema", "joint")
    assert first.exit_code == 0
    assert emla("schema", "joint").stdout == first.stdout
    schema = json.loads(first.stdout)
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    assert schema["definitions"]["Move"]["properties"]["v_peak"] == {
        "description": "peak speed [m/s]",
        "examples": [0.06],
        "exclusiveMinimum": 0.0,
        "pattern": "^\\s*[-+]?[.,]?[0-9]",
        "type": ["number", "string"],
    }


def test_command_lists_the_kinds(emla: Emla) -> None:
    text = emla("schema").stdout
    assert all(kind in text and about in text for kind, (about, _) in FILE_KINDS.items())
    assert "there is no kind of file 'joints'; choose from scenario, joint" in sentence(
        emla("schema", "joints"), 2
    )

"""All checks are described in the same way, and quote the standard."""

import json
import re
from importlib.resources import files
from pathlib import Path

import fmu_verify
from fmu_verify.catalogue import CHECKS, RECORDED


def test_checks_have_names_titles_hints_and_clauses() -> None:
    for check in (*CHECKS, RECORDED):
        assert re.fullmatch(r"[a-z_]+\.[a-z_]+", check.name)
        assert check.title[0].isupper() and not check.title.endswith("."), check.name
        assert check.hint.endswith(".") and check.clause.section and check.clause.sentence, check.name
        if check.clause.document == "FMI 2.0.4":
            assert re.fullmatch(r"[1-5](\.\d)*|fmi2\w+\.xsd", check.clause.section), check.name


def test_checks_of_fmi_3_quote_its_clauses_and_functions() -> None:
    for check in (c for c in CHECKS if c.only_for != 2):
        third = check.of(3)
        assert third.clause.document != "FMI 2.0.4", check.name
        if third.clause.document == "FMI 3.0.2":
            assert re.fullmatch(r"[1-5](\.\d+)*|fmi3PlatformTypes.h", third.clause.section), check.name
        assert "fmi2" not in third.title + third.hint, check.name
        assert check.of(2) == check


def test_needed_checks_come_first() -> None:
    names = [c.name for c in (*CHECKS, RECORDED)]
    assert len(set(names)) == len(names)
    for index, check in enumerate((*CHECKS, RECORDED)):
        assert set(check.needs) <= set(names[:index]), check.name


def test_schema_files_are_quoted_verbatim() -> None:
    for check in (c for c in CHECKS if c.clause.section.endswith(".xsd")):
        schema = files("fmpy").joinpath("schema", "fmi2", check.clause.section)
        assert check.clause.sentence in schema.read_text(encoding="utf-8"), check.name


def test_quotations_are_those_that_checks_name() -> None:
    """A name without a quotation would end a check only when it reports this fault."""
    folder = Path(fmu_verify.__file__).parent
    sources = [path.read_text(encoding="utf-8") for path in folder.rglob("*.py")]
    names = {name for text in sources for name in re.findall(r'quote\("([\w.]+)"\)', text)}
    quotations = json.loads((folder / "quotations.json").read_text(encoding="utf-8")).keys()
    assert names <= quotations <= names | {c.name for c in (*CHECKS, RECORDED)}

"""All checks are told of in the same way, and quote the standard."""

import re
from importlib.resources import files

import pytest

from emla_cosim.verification.catalogue import CHECKS
from emla_cosim.verification.check import Check


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.name)
def test_check_is_well_told(check: Check) -> None:
    assert re.fullmatch(r"[a-z_]+\.[a-z_]+", check.name)
    assert check.title[0].isupper()
    assert not check.title.endswith(".")
    assert check.hint.endswith(".")
    if check.clause.document == "FMI 2.0.4":
        assert re.fullmatch(r"[1-5](\.\d)*|fmi2\w+\.xsd", check.clause.section)


@pytest.mark.parametrize("check", [c for c in CHECKS if c.only_for != 2], ids=lambda c: c.name)
def test_check_is_told_in_the_terms_of_fmi_3(check: Check) -> None:
    """No clause of FMI 2.0 is quoted for an FMU of FMI 3.0, and no function of it is named."""
    third = check.of(3)
    assert third.clause.document != "FMI 2.0.4"
    if third.clause.document == "FMI 3.0.2":
        assert re.fullmatch(r"[1-5](\.\d+)*|fmi3PlatformTypes.h", third.clause.section)
    assert "fmi2" not in third.title + third.hint
    assert check.of(2) == check


def test_needs_stand_before() -> None:
    names = [c.name for c in CHECKS]
    assert len(set(names)) == len(names)
    for place, check in enumerate(CHECKS):
        assert set(check.needs) <= set(names[:place]), check.name


@pytest.mark.parametrize(
    "check", [c for c in CHECKS if c.clause.section.endswith(".xsd")], ids=lambda c: c.name
)
def test_schema_files_are_quoted_verbatim(check: Check) -> None:
    schema = files("fmpy").joinpath("schema", "fmi2", check.clause.section).read_text(encoding="utf-8")
    assert check.clause.sentence in schema

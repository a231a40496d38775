"""Faults of SSP documents that other tools write: accepted with `lenient`, or named."""

from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from tests.support.ssp_documents import component, fake_fmu, rooted, understood


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmus")
    return {"a__fmu": fake_fmu(folder / "a.fmu", "y:output", "n:parameter:Integer", "s:input:String")}


@pytest.mark.parametrize(
    ("connectors", "words"),
    [
        (["y:output:Integer"], "the connector a.y is of type Integer, but the variable is of type Real"),
        (["n:parameter:Real"], "the connector a.n is of type Real, but the variable is of type Integer"),
        (["y:output", "absent:parameter"], "the connector a.absent has no variable in 'a.fmu'"),
    ],
)
def test_connectors_that_differ_are_accepted_with_lenient(
    connectors: list[str], words: str, tmp_path: Path, fmus: dict[str, Path]
) -> None:
    path = rooted(tmp_path, component("a", "a.fmu", " ".join(connectors)), files=fmus)
    with pytest.raises(CommandError, match=f"{words}.*--lenient"):
        understood(path)
    with accept_faults(lenient=True) as faults:
        assert understood(path).wires() == {}
    assert any(words in remark for remark in faults.remarks(None))


def test_connectors_of_a_text_are_refused(tmp_path: Path, fmus: dict[str, Path]) -> None:
    path = rooted(tmp_path, component("a", "a.fmu", "s:input:Real"), files=fmus)
    with accept_faults(lenient=True), pytest.raises(CommandError, match="the variable is of type String"):
        understood(path)


def test_wrong_namespaces_are_named(tmp_path: Path, fmus: dict[str, Path]) -> None:
    path = rooted(tmp_path, component("a", "a.fmu", "y:output"), files=fmus)
    path = path / "SystemStructure.ssd" if path.is_dir() else path
    text = path.read_text(encoding="utf-8")
    draft = "http://www.pmsf.net/xsd/SystemStructureDescriptionDraft"
    path.write_text(text.replace("http://ssp-standard.org/SSP1/SystemStructureDescription", draft))
    with pytest.raises(CommandError, match=f"is in the namespace '{draft}'; SSP has it in 'http://ssp-stand"):
        understood(path)

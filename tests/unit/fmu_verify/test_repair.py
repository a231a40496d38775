"""`emla repair`: what it mends, what it leaves, and what it never touches."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

import emla_cosim as ec
from fmu_verify.check import Verdict
from fmu_verify.checks.description import find_schema_problems
from fmu_verify.repair import repairing
from fmu_verify.repair.attribute_rules import mend_encoding
from fmu_verify.repair.repairing import Repair, repair
from tests.support.broken.editing import (
    DESCRIPTION,
    Files,
    append,
    good_files,
    remove,
    setting,
    with_files,
    with_text,
    with_tree,
    without,
)
from tests.support.broken.examining import examine
from tests.support.broken.static import LIBRARY, STATIC
from tests.support.broken.third import THIRD

BROKEN = {b.name: b.build for b in (*STATIC, *THIRD)}


@pytest.fixture
def mend(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[Callable[[Path], Path]], Repair]:
    """Builds an FMU and repairs it, with checks in this process."""

    class _Verified:
        def __init__(self, path: Path, only: tuple[str, ...]) -> None:
            self.examined = (examine(path, *only, apart=()),)

    monkeypatch.setattr(repairing, "verify", lambda paths, only: _Verified(_path(paths), only))
    return lambda build: repair(build(tmp_path))


def _path(paths: Any) -> Path:
    return next(iter(paths.values())) if isinstance(paths, dict) else paths


def description(result: Repair) -> Any:
    with zipfile.ZipFile(io.BytesIO(result.content)) as archive:
        return etree.fromstring(archive.read(DESCRIPTION))


def texts(result: Repair) -> list[tuple[str, str]]:
    return [(c.before, c.after) for c in result.changes]


# fmt: off
MENDED = {
    "latin-1": "description.encoding", "no-unit": "units.defined",
    "continuous-integer": "variables.attributes", "output-not-listed": "structure.outputs",
    "unknowns-disordered": "structure.initial_unknowns", "unknown-not-listed": "structure.initial_unknowns",
    "depends-on-nothing": "structure.dependencies", "kinds-missing": "structure.dependencies",
    "third-no-output": "structure.outputs", "third-no-unknown": "structure.initial_unknowns",
    "third-kind": "structure.dependencies",
}
# fmt: on


@pytest.mark.parametrize(("name", "check"), MENDED.items())
def test_checks_pass_after_the_repair(name: str, check: str, mend: Callable[..., Repair]) -> None:
    result = mend(BROKEN[name])
    assert [f.check for f in result.before.of(Verdict.FAILED)] == [check]
    assert {c.check for c in result.changes} == {check}
    assert not result.after.of(Verdict.FAILED) + result.after.of(Verdict.WARNING)
    assert all(c.find_clause(result.version).sentence for c in result.changes)


@pytest.mark.parametrize("name", ["unknown-attribute", "beyond-max", "one-reference", "no-start"])
def test_faults_with_several_remedies_stay(name: str, mend: Callable[..., Repair]) -> None:
    result = mend(BROKEN[name])
    assert not result.changes
    assert result.content == result.path.read_bytes()
    assert [f.check for f in result.remaining] == [f.check for f in result.before.of(Verdict.FAILED)]


def test_other_entries_keep_bytes_order_and_times(mend: Callable[..., Repair]) -> None:
    result = mend(BROKEN["no-unit"])
    with zipfile.ZipFile(result.path) as old, zipfile.ZipFile(io.BytesIO(result.content)) as new:
        for before, after in zip(old.infolist(), new.infolist(), strict=True):
            assert (before.filename, before.date_time, before.compress_type, before.external_attr) == (
                (after.filename, after.date_time, after.compress_type, after.external_attr)
            )
            assert (old.read(before) == new.read(after)) == (before.filename != DESCRIPTION)


@pytest.mark.parametrize("name", ["no-unit", "third-no-output"])
def test_file_says_what_was_changed(name: str, mend: Callable[..., Repair]) -> None:
    result = mend(BROKEN[name])
    root = description(result)
    (change,) = root.iterfind(".//Repairs/Repair/Change")
    assert dict(change.attrib) == vars(result.changes[0])
    assert not find_schema_problems(root, f"fmi{result.version}ModelDescription.xsd")


GUID = etree.fromstring(good_files()[DESCRIPTION]).get("guid")
DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'
# fmt: off
ONE_FORM = [
    ("/*", "generationDateAndTime", "2015-06-01 12:00:00", "2015-06-01T12:00:00Z"),
    ("/*", "generationDateAndTime", "2015-06-01T12:00:00+0200", "2015-06-01T10:00:00Z"),
    ("//ScalarVariable[@name='force']", "causality", "Input", "input"),
    ("//CoSimulation", "canGetAndSetFMUstate", "True", "true"),
    ("//ScalarVariable[@name='x']/Real", "declaredType", "LENGTH", "Length"),
    ("/*", "guid", GUID.upper(), GUID),
    ("//CoSimulation | //ModelExchange", "modelIdentifier", "TOY", "Toy"),
]
# fmt: on


@pytest.mark.parametrize(("path", "attribute", "old", "new"), ONE_FORM, ids=[row[2] for row in ONE_FORM])
def test_texts_with_one_right_form(
    path: str, attribute: str, old: str, new: str, mend: Callable[..., Repair]
) -> None:
    """The case of the GUID and of the identifier is that of the library."""
    result = mend(setting(path, **{attribute: old}))
    assert set(texts(result)) == {(old, new)}
    assert not result.remaining


def test_missing_declaration_is_written(mend: Callable[..., Repair]) -> None:
    assert texts(mend(with_text(DECLARATION, ""))) == [("", DECLARATION)]


def test_guid_that_no_library_has_stays(mend: Callable[..., Repair]) -> None:
    assert not mend(setting("/*", guid="{01234567-89ab-cdef-0123-456789abcdef}")).changes


def test_identifier_stays_if_libraries_disagree(mend: Callable[..., Repair]) -> None:
    def edit(files: Files) -> None:
        files[DESCRIPTION] = files[DESCRIPTION].replace(b'modelIdentifier="Toy"', b'modelIdentifier="TOY"')
        files["binaries/darwin64/toy.dylib"] = files[LIBRARY]

    assert not mend(with_files(edit)).changes


def test_order_of_annotations_is_removed_and_accepted_by_a_run(
    mend: Callable[..., Repair], tmp_path: Path
) -> None:
    annotations = '<Annotations><Annotation type="com.tool" order="1"><a/></Annotation></Annotations>'
    build = with_tree(lambda root: root.append(etree.fromstring(annotations)), fmi=3)
    repaired = mend(build)
    assert texts(repaired) == [('<Annotation type="com.tool" order="1">', '<Annotation type="com.tool">')]
    assert not repaired.remaining
    result = ec.load(build(tmp_path), stop_time=0.1).prepare().run()
    assert any("attribute 'order'" in remark for remark in result.remarks)


def test_lists_of_vendor_annotations_are_joined(mend: Callable[..., Repair]) -> None:
    def edit(root: etree._Element) -> None:
        variables = root.find("ModelVariables")
        assert variables is not None
        for name in ("one", "two", "one"):
            variables.addprevious(
                etree.fromstring(f'<VendorAnnotations><Tool name="{name}"/></VendorAnnotations>')
            )

    result = mend(with_tree(remove("VendorAnnotations"), edit))
    assert not result.remaining
    tools = [e.get("name") for e in description(result).iterfind("VendorAnnotations/Tool")]
    assert tools == ["one", "two", "EMLA-Cosim"]


def test_missing_unit_gets_its_display_units(mend: Callable[..., Repair]) -> None:
    result = mend(with_tree(remove("//Unit[@name='m']")))
    unit = next(e for e in description(result).iterfind("UnitDefinitions/Unit") if e.get("name") == "m")
    display_unit = unit.find("DisplayUnit")
    assert (display_unit.get("name"), float(display_unit.get("factor"))) == ("mm", 1000.0)
    assert not result.remaining


def test_indices_that_begin_at_0_stay(mend: Callable[..., Repair]) -> None:
    result = mend(setting("//Outputs/Unknown[@index='16']", dependencies="0 99"))
    assert not result.changes
    assert result.remaining


def test_unknown_that_does_not_belong_to_initial_unknowns(mend: Callable[..., Repair]) -> None:
    result = mend(with_tree(append("*/InitialUnknowns", '<Unknown index="1"/>')))
    assert texts(result) == [('<Unknown index="1">', "")]
    assert not result.remaining


def test_bytes_of_windows_in_a_document_that_says_utf_8(mend: Callable[..., Repair]) -> None:
    def edit(files: Files) -> None:
        text = files[DESCRIPTION].decode("utf-8").encode("ascii", "ignore")
        files[DESCRIPTION] = text.replace(b'generationTool="', b'generationTool="M\xfcller ')

    result = mend(with_files(edit))
    assert texts(result) == [("WINDOWS-1252", "UTF-8")]
    assert description(result).get("generationTool").startswith("Müller ")


def test_archive_that_cannot_be_unpacked(mend: Callable[..., Repair]) -> None:
    with pytest.raises(ec.CommandError, match="cannot be repaired: "):
        mend(BROKEN["cut-archive"])


def test_second_repair_changes_nothing(mend: Callable[..., Repair]) -> None:
    result = mend(without("//Unit[@name='W']"))
    result.path.write_bytes(result.content)
    assert not mend(lambda _: result.path).changes


def test_utf_16_text_is_converted_completely_or_not_at_all() -> None:
    """Half a character at the end has no meaning: nothing of the user's text is replaced by a guess."""
    text = '<?xml version="1.0" encoding="UTF-16"?><a unit="\u2126"/>'
    mended, changes = mend_encoding(text.encode("utf-16"))
    assert mended.decode() == text.replace('encoding="UTF-16"?>', 'encoding="UTF-8"?>\n')
    assert changes
    cut = text.encode("utf-16")[:-1]
    assert mend_encoding(cut) == (cut, [])

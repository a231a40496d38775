"""Hostile or odd files: each gets a message that says what it is, and none ends an examination."""

import zipfile
from pathlib import Path

import pytest

from emla_cosim.verification.catalogue import STATIC
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.editing import (
    DESCRIPTION,
    Files,
    good_files,
    setting,
    with_files,
    with_text,
    without,
    written,
)
from tests.support.broken.examining import examine, list_problems
from tests.support.broken.static import LIBRARY

NAMES = tuple(c.name for c in STATIC if c.name != "sources.compile")
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
BOMB = f'<!DOCTYPE x [<!ENTITY l0 "lol">{LAUGHS}]>\n<fmiModelDescription author="&l11;"'
EXTERNAL = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<fmiModelDescription'


@pytest.mark.parametrize("start", [BOMB, EXTERNAL], ids=["bomb", "external"])
def test_entities_are_not_resolved(start: str, tmp_path: Path) -> None:
    finding = examine(with_text("<fmiModelDescription", start)(tmp_path), "description.readable").findings[0]
    assert finding.verdict == Verdict.FAILED
    assert "has an error" not in finding.sentence and len(finding.sentence) < 600


UNREADABLE = {
    "empty": b"",
    "zeros": b"\0" * 1000,
    "half": b"\xff\xfe<\0",
    "deep": b"<a>" * 100_000,
    "utf-16": "<fmiModelDescription fmiVersion='2.0'/>".encode("utf-16"),
}


@pytest.mark.parametrize("content", UNREADABLE.values(), ids=UNREADABLE)
def test_unreadable_model_description(content: bytes, tmp_path: Path) -> None:
    path = with_files(lambda files: files.update({DESCRIPTION: content}))(tmp_path)
    finding = examine(path, "description.readable").findings[0]
    assert finding.verdict == Verdict.FAILED and "has an error" not in finding.sentence


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("1.0", "It is an FMI 1.0 FMU"),
        ("3.0-beta.3", "It is an FMI 3.0-beta.3 FMU"),
        ("x" * 9999, "It is an FMI xxx"),
    ],
)
def test_other_versions_are_named(version: str, words: str, tmp_path: Path) -> None:
    finding = examine(setting("/*", fmiVersion=version)(tmp_path), "description.readable").findings[0]
    assert finding.sentence.startswith(words)
    assert len(finding.sentence) < 600


ENTRIES = {
    "file-and-folder": [("a", b""), ("a/b", b"")],
    "long": [("x" * 300, b"")],
    "drive": [("C:\\evil", b"")],
    "absolute": [("/etc/evil", b"")],
    "folder": [(f"{DESCRIPTION}/", b"")],
}


@pytest.mark.parametrize("entries", ENTRIES.values(), ids=ENTRIES)
def test_odd_entries_are_refused(entries: list[tuple[str, bytes]], tmp_path: Path) -> None:
    report = examine(written(tmp_path / "Toy.fmu", [*good_files().items(), *entries]), "archive.safe")
    assert report["archive.safe"].verdict == Verdict.FAILED
    assert "has an error" not in report["archive.safe"].sentence
    assert [p.name for p in tmp_path.iterdir() if "evil" in p.name] == []


def test_names_that_differ_in_case_get_a_warning(tmp_path: Path) -> None:
    entries = [*good_files().items(), ("Documentation/Index.html", b"")]
    finding = examine(written(tmp_path / "Toy.fmu", entries), "archive.safe").findings[0]
    assert finding.verdict == Verdict.WARNING
    assert "documentation/index.html and Documentation/Index.html" in finding.sentence


@pytest.mark.parametrize("name", ["nowhere.fmu", "folder.fmu", "text.fmu"])
def test_file_that_is_not_an_archive(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder.fmu").mkdir()
    (tmp_path / "text.fmu").write_text("Not Found")
    report = examine(tmp_path / name, *NAMES)
    assert list_problems(report).keys() == {"archive.safe"}
    assert "has an error" not in report["archive.safe"].sentence
    assert {f.verdict for f in report.findings[1:]} == {Verdict.SKIPPED}


@pytest.mark.parametrize("place", ["binaries", "sources", "documentation", f"{LIBRARY}/inside"])
def test_files_in_place_of_folders(place: str, tmp_path: Path) -> None:
    def edit(files: Files) -> None:
        for name in [n for n in files if n.startswith(place.removesuffix("/inside"))]:
            del files[name]
        files[place] = b"!"

    names = ("archive", "documents.present", "sources.description", "binaries.present", "binaries.platform")
    report = examine(with_files(edit)(tmp_path), *names)
    assert report["archive.safe"].verdict == Verdict.PASSED
    assert not [f for f in report.findings if "has an error" in f.sentence]


@pytest.mark.parametrize(
    "name", ["../Toy.c", "/etc/passwd", "-o", "fmi2_block.c/../fmi2_block.c\u0085", "%s"]
)
def test_sources_elsewhere_are_not_compiled(name: str, tmp_path: Path) -> None:
    path = setting("//SourceFiles/File", name=name)(tmp_path)
    finding = examine(path, "sources.compile")["sources.compile"]
    assert finding.verdict == Verdict.FAILED
    assert "is not in `sources`" in finding.sentence


@pytest.mark.parametrize("identifier", ["../Toy", "a/b", "*", ""])
def test_identifiers_are_not_paths(identifier: str, tmp_path: Path) -> None:
    path = setting("//CoSimulation | //ModelExchange", modelIdentifier=identifier)(tmp_path)
    report = examine(path, "description.identifier", "binaries.loads")
    assert report["description.identifier"].verdict == Verdict.FAILED
    assert report["binaries.loads"].verdict == Verdict.SKIPPED


def test_binaries_of_another_platform_only(tmp_path: Path) -> None:
    def edit(files: Files) -> None:
        files["binaries/riscv64-plan9/Toy.so"] = files.pop(LIBRARY)

    report = examine(with_files(edit)(tmp_path), "binaries")
    present = "There are binaries for riscv64-plan9, but none for"
    assert report["binaries.present"].sentence.startswith(present)
    assert report["binaries.symbols"].verdict == Verdict.PASSED
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert not report.passed  # nothing ran


def test_sources_only(tmp_path: Path) -> None:
    report = examine(with_files(lambda files: files.pop(LIBRARY))(tmp_path), "binaries", "sources.compile")
    assert report["binaries.present"].sentence == "There are sources only."
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert report["sources.compile"].verdict == Verdict.PASSED
    assert report.passed


@pytest.mark.parametrize(
    ("kind", "other"), [("CoSimulation", "ModelExchange"), ("ModelExchange", "CoSimulation")]
)
def test_fmu_of_one_kind_passes(kind: str, other: str, tmp_path: Path) -> None:
    report = examine(without(f"//{other}")(tmp_path), *NAMES)
    assert {f.check: f.sentence for f in report.findings if f.verdict != Verdict.PASSED} == {}


def test_encrypted_entry_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "Toy.fmu", good_files().items())
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        start = archive.start_dir
    content[start + 8] |= 1  # the flag of the first entry in the directory
    path.write_bytes(content)
    finding = examine(path, "archive.safe").findings[0]
    assert finding.verdict == Verdict.FAILED
    assert "encrypted" in finding.sentence

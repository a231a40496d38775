"""Files that mean harm, or are merely odd: each is told what it is, and none takes an examination down."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.verification.catalogue import STATIC
from emla_cosim.verification.findings import Examined
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
from tests.support.broken.examining import examined_here
from tests.support.broken.static import LIBRARY

NAMES = tuple(c.name for c in STATIC)
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
BOMB = f'<!DOCTYPE x [<!ENTITY l0 "lol">{LAUGHS}]>\n<fmiModelDescription author="&l11;"'
EXTERNAL = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<fmiModelDescription'
Examine = Callable[[Path], Examined]


@pytest.fixture
def examine(monkeypatch: pytest.MonkeyPatch) -> Examine:
    def examine(path: Path) -> Examined:
        report = examined_here(path, NAMES, monkeypatch)
        assert not [f for f in report.findings if "has an error" in f.sentence]
        return report

    return examine


@pytest.mark.parametrize("start", [BOMB, EXTERNAL], ids=["bomb", "external"])
def test_entities_are_not_followed(start: str, examine: Examine, tmp_path: Path) -> None:
    path = with_text("<fmiModelDescription", start)(tmp_path)
    finding = examine(path)["description.readable"]
    assert finding.verdict == Verdict.FAILED
    assert len(finding.sentence) < 600


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 1000,
        b"\xff\xfe<\0",
        b"<a>" * 100_000,
        "<fmiModelDescription fmiVersion='2.0'/>".encode("utf-16"),
    ],
    ids=["empty", "zeros", "half", "deep", "utf-16"],
)
def test_no_model_description(content: bytes, examine: Examine, tmp_path: Path) -> None:
    path = with_files(lambda files: files.update({DESCRIPTION: content}))(tmp_path)
    assert examine(path)["description.readable"].verdict == Verdict.FAILED


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("1.0", "It is an FMI 1.0 FMU"),
        ("3.0-beta.3", "It is an FMI 3.0-beta.3 FMU"),
        ("x" * 9999, "It is an FMI xxx"),
    ],
)
def test_other_versions_are_told(version: str, words: str, examine: Examine, tmp_path: Path) -> None:
    finding = examine(setting("/*", fmiVersion=version)(tmp_path))["description.readable"]
    assert finding.sentence.startswith(words)
    assert len(finding.sentence) < 600


@pytest.mark.parametrize(
    "entries",
    [
        [("a", b""), ("a/b", b"")],
        [("x" * 300, b"")],
        [("C:\\evil", b"")],
        [("/etc/evil", b"")],
        [(f"{DESCRIPTION}/", b"")],
    ],
    ids=["file-and-folder", "long", "drive", "absolute", "folder"],
)
def test_odd_entries_are_refused(entries: list[tuple[str, bytes]], examine: Examine, tmp_path: Path) -> None:
    report = examine(written(tmp_path / "Toy.fmu", [*good_files().items(), *entries]))
    assert report["archive.safe"].verdict == Verdict.FAILED
    assert [p.name for p in tmp_path.iterdir() if "evil" in p.name] == []


def test_names_that_differ_in_case_are_told(examine: Examine, tmp_path: Path) -> None:
    entries = [*good_files().items(), ("Documentation/Index.html", b"")]
    finding = examine(written(tmp_path / "Toy.fmu", entries))["archive.safe"]
    assert finding.verdict == Verdict.WARNING
    assert "documentation/index.html and Documentation/Index.html" in finding.sentence


@pytest.mark.parametrize("name", ["nowhere.fmu", "folder.fmu", "text.fmu"])
def test_what_is_no_archive_is_told(name: str, examine: Examine, tmp_path: Path) -> None:
    (tmp_path / "folder.fmu").mkdir()
    (tmp_path / "text.fmu").write_text("Not Found")
    report = examine(tmp_path / name)
    assert report["archive.safe"].verdict == Verdict.FAILED
    assert {f.verdict for f in report.findings[1:]} == {Verdict.SKIPPED}


@pytest.mark.parametrize("place", ["binaries", "sources", "documentation", f"{LIBRARY}/inside"])
def test_files_where_folders_should_be(place: str, examine: Examine, tmp_path: Path) -> None:
    def edit(files: Files) -> None:
        for name in [n for n in files if n.startswith(place.removesuffix("/inside"))]:
            del files[name]
        files[place] = b"!"

    assert examine(with_files(edit)(tmp_path))["archive.safe"].verdict == Verdict.PASSED


@pytest.mark.parametrize(
    "name", ["../Toy.c", "/etc/passwd", "-o", "fmi2_block.c/../fmi2_block.c\u0085", "%s"]
)
def test_sources_outside_are_not_compiled(name: str, examine: Examine, tmp_path: Path) -> None:
    finding = examine(setting("//SourceFiles/File", name=name)(tmp_path))["sources.compile"]
    assert finding.verdict == Verdict.FAILED
    assert "is not in `sources`" in finding.sentence


@pytest.mark.parametrize("identifier", ["../Toy", "a/b", "*", ""])
def test_identifiers_are_no_paths(identifier: str, examine: Examine, tmp_path: Path) -> None:
    report = examine(setting("//CoSimulation | //ModelExchange", modelIdentifier=identifier)(tmp_path))
    assert report["description.identifier"].verdict == Verdict.FAILED
    assert report["binaries.loads"].verdict == Verdict.SKIPPED


def test_binaries_for_another_platform_only(examine: Examine, tmp_path: Path) -> None:
    def edit(files: Files) -> None:
        files["binaries/riscv64-plan9/Toy.so"] = files.pop(LIBRARY)

    report = examine(with_files(edit)(tmp_path))
    assert report["binaries.present"].sentence.startswith(
        "There are binaries for riscv64-plan9, but none for"
    )
    assert report["binaries.symbols"].verdict == Verdict.PASSED
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert not report.passed  # nothing ran


def test_sources_only(examine: Examine, tmp_path: Path) -> None:
    report = examine(with_files(lambda files: files.pop(LIBRARY))(tmp_path))
    assert report["binaries.present"].sentence == "There are sources only."
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert report["sources.compile"].verdict == Verdict.PASSED
    assert report.passed


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_fmu_of_one_kind_passes(kind: str, examine: Examine, tmp_path: Path) -> None:
    other = {"CoSimulation": "ModelExchange", "ModelExchange": "CoSimulation"}[kind]
    report = examine(without(f"//{other}")(tmp_path))
    assert {f.check: f.sentence for f in report.findings if f.verdict != Verdict.PASSED} == {}


def test_encrypted_entry_is_refused(examine: Examine, tmp_path: Path) -> None:
    path = written(tmp_path / "Toy.fmu", good_files().items())
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        start = archive.start_dir
    content[start + 8] |= 1  # the flag of the first entry in the directory
    path.write_bytes(content)
    finding = examine(path)["archive.safe"]
    assert finding.verdict == Verdict.FAILED
    assert "encrypted" in finding.sentence

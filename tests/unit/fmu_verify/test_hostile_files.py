"""Hostile or odd files: each gets a message that says what it is, and none ends an examination."""

import zipfile
from pathlib import Path

import pytest

from fmu_verify.catalogue import STATIC
from fmu_verify.check import Verdict
from tests.support.broken.editing import (
    DESCRIPTION,
    Build,
    Files,
    good_files,
    setting,
    with_files,
    with_text,
    without,
    written,
)
from tests.support.broken.examining import examine
from tests.support.broken.static import LIBRARY

NAMES = tuple(c.name for c in STATIC if c.name != "sources.compile")
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
BOMB = f'<!DOCTYPE x [<!ENTITY l0 "lol">{LAUGHS}]>\n<fmiModelDescription author="&l11;"'
EXTERNAL = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<fmiModelDescription'


def described(content: bytes) -> Build:
    """Builds the good FMU with these bytes as its model description."""
    return with_files(lambda files: files.update({DESCRIPTION: content}))


def with_entries(*names: str) -> Build:
    """Builds the good FMU with more entries, which are empty."""
    entries = [(name, b"") for name in names]
    return lambda folder: written(folder / "Toy.fmu", [*good_files().items(), *entries])


def encrypted(folder: Path) -> Path:
    path = written(folder / "Toy.fmu", good_files().items())
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        start = archive.start_dir
    content[start + 8] |= 1  # the flag of the first entry in the directory
    path.write_bytes(content)
    return path


def a_folder(folder: Path) -> Path:
    (folder / "folder.fmu").mkdir()
    return folder / "folder.fmu"


def a_text(folder: Path) -> Path:
    (folder / "text.fmu").write_text("Not Found")
    return folder / "text.fmu"


IDENTIFIER, FILE = "//CoSimulation | //ModelExchange", "//SourceFiles/File"
READABLE, SAFE, COMPILE = "description.readable", "archive.safe", "sources.compile"
ELSEWHERE = "is not in `sources`"
# fmt: off
HOSTILE: dict[str, tuple[str, str, Build]] = {
    "entities that multiply": (READABLE, "", with_text("<fmiModelDescription", BOMB)),
    "entity of another file": (READABLE, "", with_text("<fmiModelDescription", EXTERNAL)),
    "empty description": (READABLE, "", described(b"")),
    "zeros": (READABLE, "", described(b"\0" * 1000)),
    "half a character": (READABLE, "", described(b"\xff\xfe<\0")),
    "deep elements": (READABLE, "", described(b"<a>" * 100_000)),
    "UTF-16": (READABLE, "", described("<fmiModelDescription fmiVersion='2.0'/>".encode("utf-16"))),
    "FMI 1.0": (READABLE, "It is an FMI 1.0 FMU", setting("/*", fmiVersion="1.0")),
    "FMI 3.0 beta": (READABLE, "It is an FMI 3.0-beta.3 FMU", setting("/*", fmiVersion="3.0-beta.3")),
    "long version": (READABLE, "It is an FMI xxx", setting("/*", fmiVersion="x" * 9999)),
    "file and folder": (SAFE, "", with_entries("a", "a/b")),
    "long name": (SAFE, "", with_entries("x" * 300)),
    "drive": (SAFE, "", with_entries("C:\\evil")),
    "absolute path": (SAFE, "", with_entries("/etc/evil")),
    "description that is a folder": (SAFE, "", with_entries(f"{DESCRIPTION}/")),
    "encrypted entry": (SAFE, "encrypted", encrypted),
    "no file": (SAFE, "", lambda folder: folder / "nowhere.fmu"),
    "folder": (SAFE, "", a_folder),
    "text": (SAFE, "", a_text),
    "source in another folder": (COMPILE, ELSEWHERE, setting(FILE, name="../Toy.c")),
    "source with an absolute path": (COMPILE, ELSEWHERE, setting(FILE, name="/etc/passwd")),
    "source that is an option": (COMPILE, ELSEWHERE, setting(FILE, name="-o")),
    "source by a detour": (COMPILE, ELSEWHERE, setting(FILE, name="fmi2_block.c/../fmi2_block.c\u0085")),
    "identifier with a path": ("description.identifier", "", setting(IDENTIFIER, modelIdentifier="../Toy")),
    "identifier with a pattern": ("description.identifier", "", setting(IDENTIFIER, modelIdentifier="*")),
    "empty identifier": ("description.identifier", "", setting(IDENTIFIER, modelIdentifier="")),
}
# fmt: on


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_file_fails_with_a_short_message(name: str, tmp_path: Path) -> None:
    check, words, build = HOSTILE[name]
    report = examine(build(tmp_path), check, "run.completes")
    finding = report[check]
    assert finding.verdict == Verdict.FAILED
    assert words in finding.sentence and "has an error" not in finding.sentence
    assert len(finding.sentence) < 600
    assert check == COMPILE or report["run.completes"].verdict == Verdict.SKIPPED
    assert not [p for p in tmp_path.iterdir() if "evil" in p.name]


def test_names_that_differ_in_case_get_a_warning(tmp_path: Path) -> None:
    finding = examine(with_entries("Documentation/Index.html")(tmp_path), SAFE).findings[0]
    assert finding.verdict == Verdict.WARNING
    assert "documentation/index.html and Documentation/Index.html" in finding.sentence


@pytest.mark.parametrize("folder_name", ["binaries", "sources", "documentation", f"{LIBRARY}/inside"])
def test_files_in_place_of_folders_cause_no_internal_error(folder_name: str, tmp_path: Path) -> None:
    def edit(files: Files) -> None:
        for name in [n for n in files if n.startswith(folder_name.removesuffix("/inside"))]:
            del files[name]
        files[folder_name] = b"!"

    names = ("archive", "documents.present", "sources.description", "binaries.present", "binaries.platform")
    report = examine(with_files(edit)(tmp_path), *names)
    assert report[SAFE].verdict == Verdict.PASSED
    assert not [f for f in report.findings if "has an error" in f.sentence]


def test_fmu_with_only_sources_passes(tmp_path: Path) -> None:
    report = examine(with_files(lambda files: files.pop(LIBRARY))(tmp_path), "binaries", COMPILE)
    assert report["binaries.present"].sentence == "There are sources only."
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert report[COMPILE].verdict == Verdict.PASSED
    assert report.passed


@pytest.mark.parametrize("other_kind", ["ModelExchange", "CoSimulation"])
def test_fmu_of_one_kind_passes(other_kind: str, tmp_path: Path) -> None:
    report = examine(without(f"//{other_kind}")(tmp_path), *NAMES)
    checks = {f.check for f in report.findings if f.verdict != Verdict.PASSED}
    assert checks == {"layered.manifests", "related.metadata"}  # it has neither manifests nor related files

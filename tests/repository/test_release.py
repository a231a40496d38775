"""What `python .ci/release.py` makes, and what it refuses."""

import hashlib
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from datetime import date
from pathlib import Path

import pytest

from emla_cosim.fmu.models import FLAVOURS, MODELS, PLATFORMS, fmu_path
from fmublock.platforms import host_platform
from tests.support.paths import ROOT
from tests.support.processes import run

pytestmark = pytest.mark.slow

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
VERSION, REQUIREMENTS = PROJECT["version"], PROJECT["dependencies"]
HEADING = re.compile(rf"^## {re.escape(VERSION)}, .*$", re.MULTILINE)
DATED = f"## {VERSION}, {date(2026, 1, 31)}"
if not (ROOT / ".git").exists():
    pytest.skip("Releases are made from a commit, and this is not a git repository.", allow_module_level=True)

pytest.importorskip("hatchling", reason="The extra 'test' is not installed.")
pytest.importorskip("cyclonedx_py", reason="The extra 'test' is not installed.")


def cloned(folder: Path) -> Path:
    """The last commit, with a changelog whose section has a date."""
    git(ROOT, "clone", "--quiet", str(ROOT), str(folder))
    changelog = folder / "CHANGELOG.md"
    changelog.write_text(HEADING.sub(DATED, changelog.read_text(encoding="utf-8")), encoding="utf-8")
    when = {"GIT_AUTHOR_DATE": "2026-01-31T12:00:00Z", "GIT_COMMITTER_DATE": "2026-01-31T12:00:00Z"}
    author = ["-c", "user.name=Somebody", "-c", "user.email=somebody@example.com"]
    git(folder, *author, "commit", "--quiet", "--allow-empty", "--all", "-m", "Release", **when)
    return folder


def git(folder: Path, *arguments: str, **env: str) -> None:
    run("git", *arguments, cwd=folder, environment=env, check=True)


def released(tree: Path, output: Path, fmus: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(tree / ".ci" / "release.py"), "--output", str(output), "--fmus", str(fmus)]
    env = {name: value for name, value in os.environ.items() if name != "SOURCE_DATE_EPOCH"}
    return run(*command, "--platform", host_platform(), *options, cwd=output.parent, env=env)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cloned(tmp_path_factory.mktemp("tree") / "clone")


@pytest.fixture(scope="module")
def artifacts(tree: Path, python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("made") / "release"
    process = released(tree, output, python_fmu_folder)
    assert process.returncode == 0, process.stderr
    assert sorted(process.stdout.splitlines()) == sorted(map(str, output.iterdir()))
    return output


def test_checksums_of_all_files(artifacts: Path) -> None:
    sums = dict(reversed(x.split("  ")) for x in (artifacts / "SHA256SUMS").read_text().splitlines())
    assert set(sums) | {"SHA256SUMS"} == {file.name for file in artifacts.iterdir()}
    assert len(sums) == 5
    for name, expected in sums.items():
        assert hashlib.sha256((artifacts / name).read_bytes()).hexdigest() == expected


def test_releases_are_reproducible(artifacts: Path, python_fmu_folder: Path, tmp_path: Path) -> None:
    """In another folder, over what an earlier release left, and beside a file of the user."""
    output = tmp_path / "again"
    output.mkdir()
    (output / "notes.txt").write_text("mine")
    (output / "emla_cosim-0.0.1.tar.gz").write_text("earlier")
    (output / "SHA256SUMS").write_text("0  emla_cosim-0.0.1.tar.gz\n")
    process = released(cloned(tmp_path / "clone"), output, python_fmu_folder)
    assert process.returncode == 0, process.stderr
    assert (output / "SHA256SUMS").read_text() == (artifacts / "SHA256SUMS").read_text()
    assert {f.name for f in output.iterdir()} == {f.name for f in artifacts.iterdir()} | {"notes.txt"}


def test_archive_has_fmus_and_their_files(artifacts: Path, python_fmu_folder: Path) -> None:
    top = f"emla-fmus-{VERSION}"
    with zipfile.ZipFile(artifacts / f"{top}.zip") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    assert content[f"{top}/LICENSE"] == (ROOT / "LICENSE").read_bytes()
    assert f"EMLA-Cosim {VERSION}".encode() in content[f"{top}/README.md"]
    expected = {f"{top}/LICENSE", f"{top}/README.md"}
    for model in MODELS:
        for flavour in FLAVOURS:
            name = fmu_path(model, flavour, Path(top)).as_posix()
            assert content[name] == fmu_path(model, flavour, python_fmu_folder).read_bytes()
            expected.add(name)
        files = [f for f in (ROOT / "fmus" / model).iterdir() if f.is_file() and f.suffix != ".fmu"]
        assert {f"{model}_ref.csv", "README.md"} <= {f.name for f in files}
        for file in files:
            assert content[f"{top}/{model}/{file.name}"] == file.read_bytes()
            expected.add(f"{top}/{model}/{file.name}")
    assert set(content) == expected


def test_packages_are_complete(artifacts: Path, tmp_path: Path) -> None:
    """The wheel has references, plugin and documents; from the sources the same wheel can be built."""
    (wheel,) = artifacts.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        points = archive.read(f"emla_cosim-{VERSION}.dist-info/entry_points.txt").decode()
    assert "[pytest11]" in points and "emla = emla_cosim.cli.program:main" in points
    references = {p.relative_to(ROOT) for p in ROOT.glob("fmus/*/*_*.*") if p.suffix != ".pyc"}
    assert len(references) > 15
    assert {f"emla_cosim/documents/{path.as_posix()}" for path in references} <= names
    assert not [name for name in names if "/tests/" in name]
    brought = {Path(name).name for name in names if name.startswith("fmublock/prebuilt/fmus/")}
    assert brought >= {f"{model}.fmu" for model in (*MODELS, "ExcavatorLoad")}
    with tarfile.open(artifacts / f"emla_cosim-{VERSION}.tar.gz") as sources:
        # Python 3.11.3 and earlier have no filters
        sources.extractall(tmp_path, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    variables = {"SOURCE_DATE_EPOCH": "1769860800", "EMLA_COSIM_PLATFORMS": host_platform()}
    run(*command, cwd=tmp_path / f"emla_cosim-{VERSION}", environment=variables, check=True)
    assert (tmp_path / wheel.name).read_bytes() == wheel.read_bytes()


def test_bill_of_materials_has_the_base_requirements(artifacts: Path) -> None:
    """It is valid, dated by the commit, and has nothing random."""
    text = (artifacts / f"emla_cosim-{VERSION}.cdx.json").read_text(encoding="utf-8")
    validation = pytest.importorskip("cyclonedx.validation.json")
    schema = pytest.importorskip("cyclonedx.schema")
    assert validation.JsonStrictValidator(schema.SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    assert "serialNumber" not in bill
    assert bill["metadata"]["timestamp"] == "2026-01-31T12:00:00+00:00"
    assert (bill["metadata"]["component"]["name"], bill["metadata"]["component"]["version"]) == (
        "emla-cosim",
        VERSION,
    )
    names = {component["name"].lower().replace("_", "-") for component in bill["components"]}
    required = {re.split(r"[^\w-]", requirement)[0].replace("_", "-") for requirement in REQUIREMENTS}
    assert required <= names
    assert not names & {"pip", "pytest", "emla-cosim"}


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        (f"## {VERSION}0, 2026-01-31", f"says nothing of version {VERSION}"),
        (f"{DATED}\n\n## 0.0.1, 2025-01-31", f"says nothing of version {VERSION}"),
        (f"## {VERSION}, unreleased", "write the day of the release"),
        (f"{DATED} ", "write the day of the release"),
        (f"{DATED}\n\nChanged.\n\n## 0.0.1, 2025-01-31", "are not as they were committed.*\n.*CHANGELOG"),
    ],
)
def test_unfinished_releases_are_refused(heading: str, words: str, tree: Path, tmp_path: Path) -> None:
    changelog = tree / "CHANGELOG.md"
    before = changelog.read_text(encoding="utf-8")
    changelog.write_text(HEADING.sub(heading, before), encoding="utf-8")
    try:
        process = released(tree, tmp_path / "release", tmp_path / "fmus")
    finally:
        changelog.write_text(before, encoding="utf-8")
    assert process.returncode == 1
    assert re.match(f"Error: .*{words}", process.stderr), process.stderr
    assert "Traceback" not in process.stderr
    assert not (tmp_path / "release").exists()


def test_unknown_platform_is_refused(tmp_path: Path) -> None:
    process = released(ROOT, tmp_path / "release", tmp_path, "--platform", "amiga")
    assert process.returncode == 2
    assert all(platform in process.stderr for platform in PLATFORMS)

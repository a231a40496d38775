"""The step of pipelines: which files and options its inputs mean, and what GitLab gets."""

import json
from pathlib import Path

import pytest

from fmu_verify import pipeline, sarif
from fmu_verify.pipeline import NoFilesError, convert_to_code_quality, find_files, list_options
from tests.support.reports import hostile, ordinary


def test_globs_match_files_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("b/deep er/2.fmu", "b/1.fmu", "[x].fmu", ".hidden/3.fmu"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert find_files("[x].fmu\n\n**/*.fmu\n") == ["[x].fmu", "b/1.fmu", "b/deep er/2.fmu"]
    assert find_files(f"{tmp_path}/b/*.fmu") == [f"{tmp_path}/b/1.fmu"]
    assert find_files("b") == ["b"]


@pytest.mark.parametrize(
    ("globs", "message"), [("", "is empty"), ("\n\n", "is empty"), ("b/*.fmu", "'b/\\*.fmu'")]
)
def test_globs_without_files(
    globs: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NoFilesError, match=message):
        find_files(globs)


def test_inputs_become_options() -> None:
    inputs = {"VERIFY_ONLY": "run\n\nstate.*\n", "VERIFY_FAIL_ON": "warning", "VERIFY_SKIP": "", "ONLY": "x"}
    assert list(list_options(inputs)) == ["--only=run", "--only=state.*", "--fail-on=warning"]


def test_message_without_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["pipeline", "out"])
    monkeypatch.setenv("VERIFY_FMUS", "100%.fmu")
    for on_github, expected in (
        ("true", "::error title=FMUs were not verified::The input fmus has '100%25.fmu'"),
        ("", "Error: "),
    ):
        monkeypatch.setenv("GITHUB_ACTIONS", on_github)
        (tmp_path / "out").mkdir(exist_ok=True)
        (tmp_path / "out/report.json").write_text("of an earlier run")
        with pytest.raises(SystemExit) as ended:
            pipeline.main()
        assert ended.value.code == 2
        assert expected in "".join(capsys.readouterr())
        assert list((tmp_path / "out").iterdir()) == []


def test_folder_that_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").touch()
    monkeypatch.setattr("sys.argv", ["pipeline", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        pipeline.main()
    assert ended.value.code == 2
    assert f"The folder of reports '{tmp_path / 'out'}' cannot be used: " in "".join(capsys.readouterr())


def test_entries_of_code_quality() -> None:
    entries = convert_to_code_quality(json.loads(sarif.render(ordinary())))
    assert [(e["check_name"], e["severity"], e["description"]) for e in entries] == [
        ("state.restored", "major", "x is 2 where it was 1."),
        ("reference.tube", "major", "motor.v leaves its tube."),
        ("description.units", "minor", "motor.v has no unit."),
    ]
    assert all(e["location"] == {"path": "build/Plant.fmu", "lines": {"begin": 1}} for e in entries)
    assert len({e["fingerprint"] for e in entries}) == 3
    assert all(e["description"] for e in convert_to_code_quality(json.loads(sarif.render(hostile()))))

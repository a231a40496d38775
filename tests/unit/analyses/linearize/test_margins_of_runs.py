"""Runs show the margins of `emla linearize` in record and report."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import emla_cosim as ec
from emla_cosim.cli.app import app
from tests.oracles.test_linearize import OPTIONS, closed

RESULT = '{"format": "emla-linearization", "scenario": "s", "at_s": 1,'
RUN_OPTIONS = {"step_size": OPTIONS["step_size"], "stop_time": 1.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of a linearization."""
    out = tmp_path_factory.mktemp("margins") / "out"
    ec.linearize(closed(), open="gain.force->cart.force", output=out, plots=False, **OPTIONS)
    return out


@pytest.mark.slow
def test_report_of_a_run_shows_margins(folder: Path, tmp_path: Path) -> None:
    stored = json.loads((folder / "linearize.json").read_text())["responses"]
    margins = stored["gain.force -> cart.force"]["margins"]
    result = ec.load(closed(), margins=folder, **RUN_OPTIONS).prepare().run()
    assert result.record["margins"]["loops"] == {"gain.force -> cart.force": margins}
    result.save(tmp_path / "with", plots=False, report=True)
    page = (tmp_path / "with" / "report.html").read_text(encoding="utf-8")
    assert "<h2>Stability margins of system at 2 s</h2>" in page and "gain.force -&gt; cart.force" in page
    assert f'<td class="figure">{margins["phase_deg"]:.4g}</td>' in page
    assert margins["gain_down_dB"] is None and '<td class="figure">none</td>' in page
    ec.load(closed(), **RUN_OPTIONS).prepare().run().save(tmp_path / "without", plots=False, report=True)
    assert "Stability margins" not in (tmp_path / "without" / "report.html").read_text(encoding="utf-8")


def test_run_command_reads_margins(folder: Path, tmp_path: Path) -> None:
    system = tmp_path / "closed.ssp"
    ec.load(closed(), **RUN_OPTIONS).export(system)
    arguments = ["--no-plots", "--margins", str(folder / "linearize.json"), "--output", str(tmp_path / "out")]
    process = CliRunner().invoke(app, ["run", str(system), *arguments])
    assert process.exit_code == 0, process.output
    assert json.loads((tmp_path / "out" / "run.json").read_text())["margins"]["at_s"] == 2.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        ("{", "is not a linearization result"),
        ("[]", "is not a linearization result"),
        ('{"format": "emla-run"}', "is not a linearization result"),
        (f'{RESULT} "matrices": {{}}}}', "has no margins"),
        (f'{RESULT} "responses": {{"a": {{"margins": null}}}}}}', "has no margins"),
        (f'{RESULT} "responses": {{"a": {{}}}}}}', "has no margins"),
        (
            '{"format": "emla-linearization", "responses": {"a": {"margins": {"Ms": 2}}}}',
            "is not a linearization result",
        ),
        (f'{RESULT} "responses": {{"a": {{"margins": {{"Ms": "x"}}}}}}}}', "is not a linearization result"),
        (f'{RESULT} "responses": {{"a": {{"margins": [1]}}}}}}', "is not a linearization result"),
    ],
)
def test_other_files_get_an_error_message(content: str | None, message: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "linearize.json").write_text(content)
    with pytest.raises(ec.CommandError, match=message):
        ec.load(closed(), margins=tmp_path, **RUN_OPTIONS).prepare().run()

"""`--quiet`, before or after the command: only errors and requested output, and the same exit codes."""

from pathlib import Path

import pytest

from tests.support.commands import Emla, sentence

SHORT_RUN = ("--stop-time", "0.001", "--no-plots", "--output", "out")


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "lift", *SHORT_RUN, "--replace", "lift.controller={controller}", "-q"),
        ("-q", "run", "lift", *SHORT_RUN, "--fmus", "{fmus}"),
        ("export", "--quiet", "lift", "x.ssp"),
        ("rerun", "--quiet", "first", "--no-plots", "--fmus", "{fmus}"),
        pytest.param(
            ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", "--workers", "1", *SHORT_RUN, "-q"),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda arguments: arguments[0],
)
def test_quiet_command_prints_nothing(arguments: tuple[str, ...], emla: Emla, fmu_folder: Path) -> None:
    controller = fmu_folder / "RsbaController" / "RsbaController.fmu"
    texts = [a.format(fmus=fmu_folder, controller=controller) for a in arguments]
    if texts[0] == "rerun":
        assert emla("run", "lift", *SHORT_RUN[:-1], "first").exit_code == 0
    result = emla(*texts)
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert emla("list").stdout, "the next command prints again"


def test_errors_and_exit_codes_are_the_same(emla: Emla) -> None:
    assert "stop time" in sentence(emla("run", "lift", "-q", "--stop-time", "-1"), 2)
    result = emla("run", "lift", "-q", *SHORT_RUN, "--require", "run.steps < 1")
    assert "steps" in sentence(result, 1)
    assert result.stdout == "" and len(result.stderr.splitlines()) == 1


def test_requested_output_is_printed(emla: Emla) -> None:
    for arguments in (("list", "-q"), ("-q", "list")):
        assert emla(*arguments).stdout == emla("list").stdout != ""
    assert emla("verify", "--list", "-q").stdout == emla("verify", "--list").stdout != ""
    assert emla("-q", "--version").stdout.startswith("emla-cosim ")

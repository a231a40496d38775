"""`--quiet`: nothing but errors and what was asked for, before or after the command, and the same end."""

from pathlib import Path

import pytest

from tests.support.commands import Emla, sentence

SHORT = ("--stop-time", "0.001", "--no-plots", "--output", "out")


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "lift", "-q", *SHORT),
        ("run", "--quiet", "lift", *SHORT),
        ("run", "lift", *SHORT, "--replace", "lift.controller={controller}", "-q"),
        ("export", "lift", "x.ssp", "-q"),
        ("rerun", "--quiet", "first", "--no-plots", "--fmus", "{fmus}"),
        ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", "--workers", "1", *SHORT, "-q"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_nothing_is_said(arguments: tuple[str, ...], emla: Emla, fmu_folder: Path) -> None:
    controller = fmu_folder / "RsbaController" / "RsbaController.fmu"
    given = [a.format(fmus=fmu_folder, controller=controller) for a in arguments]
    if given[0] == "rerun":
        assert emla("run", "lift", *SHORT[:-1], "first").exit_code == 0
    result = emla(*given)
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert emla(*SHORT[:0], "list").stdout, "the next command speaks again"


def test_it_may_stand_before_the_command(emla: Emla, fmu_folder: Path) -> None:
    for flag in ("-q", "--quiet"):
        result = emla(flag, "run", "lift", *SHORT, "--fmus", str(fmu_folder))
        assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


def test_errors_are_told_and_codes_are_those_of_a_command_that_speaks(emla: Emla) -> None:
    assert "stop time" in sentence(emla("run", "lift", "-q", "--stop-time", "-1"), 2)
    result = emla("run", "lift", "-q", *SHORT, "--require", "run.steps < 1")
    assert "steps" in sentence(result, 1)
    assert result.stdout == "" and len(result.stderr.splitlines()) == 1


def test_what_was_asked_for_is_shown(emla: Emla) -> None:
    for arguments in (("list", "-q"), ("-q", "list")):
        assert emla(*arguments).stdout == emla("list").stdout != ""
    assert emla("verify", "--list", "-q").stdout == emla("verify", "--list").stdout != ""
    assert emla("-q", "--version").stdout.startswith("emla-cosim ")

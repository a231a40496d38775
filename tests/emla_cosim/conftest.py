"""The `emla` command as a fixture."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emla_cosim.cli import app
from tests.support.commands import Emla, widen_terminal


@pytest.fixture
def emla(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Emla:
    """Run `emla` in an empty folder; it finds the FMUs that the session has built."""
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch)

    def call(*arguments: str) -> Result:
        takes_fmus = (
            arguments[0] in ("run", "export", "sweep", "tune", "compare", "info")
            and "--fmus" not in arguments
        )
        more = ["--fmus", str(fmu_folder)] if takes_fmus else []
        return CliRunner().invoke(app, [*arguments, *more])

    return call

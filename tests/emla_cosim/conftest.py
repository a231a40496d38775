"""The `emla` command as a fixture."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emla_cosim.cli.app import app
from tests.support.commands import Emla, widen_terminal
from tests.support.few_figures import draw_empty


@pytest.fixture
def emla(
    request: pytest.FixtureRequest, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Emla:
    """Run `emla` in an empty folder; it finds the FMUs that the session has built.

    Pictures are empty unless the test is marked as `drawn`.
    """
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch)
    if request.node.get_closest_marker("drawn") is None:
        draw_empty(monkeypatch)

    def call(*arguments: str) -> Result:
        takes_fmus = (
            arguments[0] in ("run", "rerun", "export", "sweep", "tune", "compare", "info")
            and "--fmus" not in arguments
        )
        more = ["--fmus", str(fmu_folder)] if takes_fmus else []
        return CliRunner().invoke(app, [*arguments, *more])

    return call

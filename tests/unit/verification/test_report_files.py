"""Reports are written completely, or one error message says why not."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.verification.report import Report
from tests.support.full_disk import files_of_at_most
from tests.support.reports import ordinary

Save = Callable[..., None]
FORMS: dict[str, Save] = {"JSON": Report.save_json, "JUnit": Report.save_junit, "HTML": Report.save_html}


@pytest.fixture(params=FORMS)
def form(request: pytest.FixtureRequest) -> str:
    return request.param


def test_invalid_paths(form: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("endless")
    wrong = {
        tmp_path: "it is a folder",
        Path("/dev/null"): "it is a device",
        tmp_path / "pipe": "it is a pipe",
        tmp_path / "no/r": "there is no folder",
        tmp_path / "endless": "it is a symbolic link",
        tmp_path / "a\0b": "embedded null",
    }
    for path, why in wrong.items():
        with pytest.raises(CommandError, match=f"^the {form} report .*cannot be written: .*{why}") as caught:
            FORMS[form](ordinary(), path)
        assert "\n" not in str(caught.value)


def test_full_disk_keeps_the_earlier_report(form: str, tmp_path: Path) -> None:
    path = tmp_path / "r"
    FORMS[form](ordinary(), path)
    before = path.read_bytes()
    with (
        files_of_at_most(100),
        pytest.raises(RunError, match=f"the {form} report '.*' cannot be written: File too large"),
    ):
        FORMS[form](ordinary(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["r"]


def test_target_of_a_link_is_not_written(form: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    with pytest.raises(CommandError, match="it is a symbolic link"):
        FORMS[form](ordinary(), tmp_path / "link", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert not (tmp_path / "real").exists()


def test_report_replaces_reports_of_its_kind_only(form: str, tmp_path: Path) -> None:
    for other, save in FORMS.items():
        save(ordinary(), tmp_path / other)
    for other in FORMS:
        if other != form:
            with pytest.raises(CommandError, match="was not written by emla"):
                FORMS[form](ordinary(), tmp_path / other)
    FORMS[form](ordinary(), tmp_path / form)

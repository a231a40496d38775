"""Reports go where they were sent, whole, or one sentence says why not."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.verification.report import Report
from tests.support.full_disk import files_of_at_most
from tests.support.reports import ordinary

Save = Callable[[Report, Path], None]
FORMS: dict[str, Save] = {"JSON": Report.save_json, "JUnit": Report.save_junit, "HTML": Report.save_html}


@pytest.fixture(params=FORMS)
def form(request: pytest.FixtureRequest) -> str:
    return request.param


def test_places_where_no_file_can_be(form: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("endless")
    wrong = {
        tmp_path: "it is a folder",
        Path("/dev/null"): "it is a device",
        tmp_path / "pipe": "it is a pipe",
        tmp_path / "no/r": "there is no folder",
        tmp_path / "endless": "Too many levels of symbolic links",
        tmp_path / "a\0b": "embedded null",
    }
    for path, why in wrong.items():
        with pytest.raises(CommandError, match=f"^the {form} report .*cannot be written: .*{why}") as caught:
            FORMS[form](ordinary(), path)
        assert "\n" not in str(caught.value)


def test_a_full_disk_leaves_the_earlier_report(form: str, tmp_path: Path) -> None:
    path = tmp_path / "r"
    path.write_text("before")
    with (
        files_of_at_most(100),
        pytest.raises(RunError, match=f"the {form} report '.*' cannot be written: File too large"),
    ):
        FORMS[form](ordinary(), path)
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["r"]


def test_what_a_link_leads_to_is_written(form: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    FORMS[form](ordinary(), tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").stat().st_size > 1000

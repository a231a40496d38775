"""Commands and code in the documentation work as shown; see `support.pages`."""

import sys
from pathlib import Path

import pytest

from tests.support.commands import widen_terminal
from tests.support.few_figures import draw_empty
from tests.support.pages import PAGES, PageError, Reader, fences
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow


@pytest.fixture
def working_folder(tmp_path: Path, on_one_cluster: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in; FMUs are built when they are first needed, as for any user."""
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch)
    draw_empty(monkeypatch)
    return tmp_path


def is_executed(page: Path) -> bool:
    """Return whether a page shows anything that is executed."""
    return any(
        fence.info.partition("=")[0] != "not-run" and fence.language in ("sh", "python")
        for fence in fences(page.read_text(encoding="utf-8"))
    )


EXECUTED = [page for page in PAGES if is_executed(page)]
BY_DEFAULT = ("actuator.md", "joints.md", "master.md", "python.md")
"""Pages of which each takes about a second."""


@pytest.mark.parametrize(
    "page",
    mostly_slow(EXECUTED, [page for page in EXECUTED if page.name in BY_DEFAULT]),
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_commands_of_a_page_work(page: Path, working_folder: Path) -> None:
    if page.name == "export.md" and sys.platform != "linux":
        pytest.skip("libcosim and Ecos have packages for Linux only.")
    Reader(page).read()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("```python\nprint('one')\n```\n```text output\ntwo\n```\n", r"line 4: \['two'\]"),
        ("```sh exit=2\nemla list\n```\n", "line 1: ended with 0"),
        ("```sh skip\nemla list\n```\n", "line 1: unknown word 'skip'"),
        ("Two.\n\n```python run\nraise SystemExit(3)\n```\n", "line 3: ended with 3"),
    ],
)
def test_failing_pages_are_reported(text: str, words: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(PageError, match=words):
        Reader(page).read()

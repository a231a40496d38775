"""The hook for pre-commit verifies the FMUs of a commit."""

import os
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
import yaml

from tests.support.pages import fences
from tests.support.paths import ROOT
from tests.support.pipelines import cut_fmu, good_fmu
from tests.support.processes import run

pytest.importorskip("pre_commit", reason="The extra 'dev' is not installed.")
PAGE = (ROOT / "docs" / "verify-in-ci.md").read_text(encoding="utf-8")
DOCUMENTED = [yaml.safe_load(f.content) for f in fences(PAGE) if f.content.startswith("repos:")]
"""The files to copy."""

HOOK = "verify-fmus"
if not (ROOT / ".git").exists():
    pytest.skip(
        "pre-commit takes hooks from git repositories only, and this is none.", allow_module_level=True
    )


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which hooks are installed without what they need: that is here already."""
    site_packages = str(Path(str(distribution("hatchling").locate_file(""))))
    variables = {
        "PRE_COMMIT_HOME": str(tmp_path_factory.mktemp("hooks")),
        "PYTHONPATH": site_packages,
        "PIP_NO_DEPS": "1",
        "PIP_NO_INDEX": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # which is how pip writes that it is to be left out
        "GIT_AUTHOR_NAME": "Somebody",
        "GIT_AUTHOR_EMAIL": "somebody@example.com",
        "GIT_COMMITTER_NAME": "Somebody",
        "GIT_COMMITTER_EMAIL": "somebody@example.com",
    }
    return {k: v for k, v in os.environ.items() if not k.startswith("GIT_")} | variables


@pytest.mark.slow
def test_fmus_of_a_commit_are_verified(tmp_path: Path, env: dict[str, str], fmu_folder: Path) -> None:
    """With the first configuration of the page; a file outside of the commit is not verified."""
    good_fmu(tmp_path / "models", fmu_folder)
    cut_fmu(tmp_path)
    (copied, *_) = DOCUMENTED
    copied["repos"][0] |= {"repo": str(ROOT), "rev": git(ROOT, env, "rev-parse", "HEAD").strip()}
    (tmp_path / ".pre-commit-config.yaml").write_text(yaml.safe_dump(copied), encoding="utf-8")
    git(tmp_path, env, "init", "-q")
    git(tmp_path, env, "add", "models", ".pre-commit-config.yaml")
    good = committed(tmp_path, env)
    assert good.returncode == 0, good.stdout + good.stderr
    assert "Reference.fmu" in good.stdout and "Cut.fmu" not in good.stdout
    git(tmp_path, env, "add", "Cut.fmu")
    bad = committed(tmp_path, env)
    assert bad.returncode == 1
    assert "Cut.fmu: failed archive.safe" in bad.stdout and "exit code: 1" in bad.stdout


def git(folder: Path, env: dict[str, str], *arguments: str) -> str:
    return run("git", *arguments, cwd=folder, env=env, check=True).stdout


def committed(repository: Path, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """What is done before each commit."""
    return run(sys.executable, "-m", "pre_commit", "run", "--verbose", cwd=repository, env=env)


def test_documented_configurations_name_the_hook() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))
    assert [hook["id"] for hook in hooks] == [HOOK]
    assert len(DOCUMENTED) == 2
    assert {hook["id"] for copy in DOCUMENTED for repo in copy["repos"] for hook in repo["hooks"]} == {HOOK}

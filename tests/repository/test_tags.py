"""Tags of this project that the documentation names exist, or are that of the release that is being made."""

import re
import tomllib

import pytest

from tests.support.paths import ROOT
from tests.support.processes import run

PAGES = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/**/*.md"),
    *ROOT.glob("paper/*.md"),
    *(path for path in ROOT.glob(".github/**/*") if path.suffix in {".md", ".yml"}),
    *(ROOT / name for name in ("action.yml", "templates/verify-fmus.yml")),
]
REFERENCE = re.compile(r"(?:emla-cosim(?:\.git)?|verify-fmus(?:\.yml)?)(?:@|\n\s*rev: )([\w.-]+)")
"""What follows the address of the project in GitHub Actions, GitLab, pip and pre-commit."""

NO_TAG = re.compile(r"main|[A-Z]+|[0-9a-f]{40}")
"""A branch, a placeholder for the reader, or a commit."""


def unknown_tags(text: str, tags: set[str]) -> list[str]:
    """Return the references in a text that are neither a branch, a placeholder, a commit nor a tag."""
    return [ref for ref in REFERENCE.findall(text) if not NO_TAG.fullmatch(ref) and ref not in tags]


def existing_tags() -> set[str]:
    """Return all tags, with that of the version if its section in the changelog has a day."""
    tags = run("git", "tag", cwd=ROOT, check=True).stdout.split()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    is_dated = re.search(rf"^## {re.escape(version)}, \d{{4}}-\d\d-\d\d$", changelog, re.MULTILINE)
    return {*tags, *([f"v{version}"] if is_dated else [])}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="Tags are those of a git repository.")
def test_named_tags_exist() -> None:
    tags = existing_tags()
    unknown = {str(p.relative_to(ROOT)): unknown_tags(p.read_text(encoding="utf-8"), tags) for p in PAGES}
    assert {page: names for page, names in unknown.items() if names} == {}


@pytest.mark.parametrize(
    ("text", "unknown"),
    [
        ("uses: OWNER/emla-cosim/.github/workflows/verify-fmus.yml@v0.1.0", ["v0.1.0"]),
        ("component: $CI_SERVER_FQDN/GROUP/emla-cosim/verify-fmus@v0.1.0", ["v0.1.0"]),
        ("pip install git+https://github.com/OWNER/emla-cosim@v0.2.0", []),
        ("pip install git+https://github.com/OWNER/emla-cosim.git@v0.3.0", ["v0.3.0"]),
        ("- repo: https://github.com/OWNER/emla-cosim\n  rev: v9\n", ["v9"]),
        ("- repo: https://github.com/OWNER/emla-cosim\n  rev: COMMIT\n", []),
        (f"emla-cosim@main, emla-cosim@{'0a' * 20}, other@v1", []),
    ],
)
def test_unknown_tags_are_found(text: str, unknown: list[str]) -> None:
    assert unknown_tags(text, {"v0.2.0"}) == unknown

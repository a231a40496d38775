"""Which tests execute a line: coverage with one context for each test, and how long each takes."""

import json
import os
import re
import subprocess
import sys

from coverage import CoverageData

from tests.support.paths import ROOT

FOLDER = ROOT / "build" / "mutation"
SETTINGS = """
[run]
source = src, orchestration
parallel = true
patch = subprocess
context = ${PYTEST_CURRENT_TEST-}
"""
"""Child processes start with the name of the test in their environment, which is their context."""

NODE = re.compile(r"(tests/\S+?\.py::.*?)(?: \((?:setup|call|teardown)\)|\|(?:setup|run|teardown))?$")


def measure(tier: str, selection: list[str]) -> int:
    """Run a tier with coverage and keep its map. Return the exit code of pytest."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    settings, data = FOLDER / "coveragerc", FOLDER / f"{tier}.coverage"
    settings.write_text(SETTINGS, encoding="utf-8")
    durations = FOLDER / f"{tier}.durations.jsonl"
    for old in (durations, *FOLDER.glob(f"{data.name}*")):
        old.unlink(missing_ok=True)
    marks = {"default": "not slow and not nightly", "slow": "slow"}[tier]
    command = [
        sys.executable, "-m", "pytest", "-m", marks, "-p", "tests.mutation.durations", "--durations-file",
        str(durations), "--cov", "--cov-config", str(settings), "--cov-context=test", "--cov-report=",
        "--ignore=tests/frozen", *selection,
    ]  # fmt: skip
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | {"COVERAGE_FILE": str(data)}, check=False
    ).returncode


def has_map(tier: str) -> bool:
    """Return whether a tier was run with coverage."""
    return (FOLDER / f"{tier}.coverage").exists()


class Covering:
    """The map of a tier."""

    def __init__(self, tier: str) -> None:
        self._data = CoverageData(str(FOLDER / f"{tier}.coverage"))
        self._data.read()
        lines = (FOLDER / f"{tier}.durations.jsonl").read_text(encoding="utf-8").splitlines()
        self.seconds: dict[str, float] = dict(map(json.loads, lines))

    def tests(self, module: str, line: int) -> list[str]:
        """Return the tests that execute a line of a module, the cheapest first."""
        contexts = self._data.contexts_by_lineno(str(ROOT / module)).get(line, [])
        names = {match[1] for context in contexts if (match := NODE.search(context))}
        return sorted(names & self.seconds.keys(), key=lambda name: self.seconds[name])

    def tests_in(self, folders: list[str]) -> list[str]:
        """Return the tests below folders, the cheapest first."""
        names = [n for n in self.seconds if n.startswith(tuple(f"{folder}/" for folder in folders))]
        return sorted(names, key=lambda name: self.seconds[name])

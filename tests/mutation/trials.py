"""Trials of mutants: in a copy of the project, with the tests that execute the changed line."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT

from .covering import FOLDER, Covering, has_map
from .mutants import Mutant

NOT_COPIED = (".git", ".venv", "build", "results")
"""At the top of the project: what no test reads, and may be large."""

NOTICED, SURVIVED = "noticed", "survived"


class Trials:
    """The trials of one drawing; each result is a line of JSON, so that the work can be continued."""

    def __init__(self, seed: int) -> None:
        self._file = FOLDER / f"seed-{seed}.jsonl"

    def results(self) -> list[dict[str, Any]]:
        """Return the last result of each mutant."""
        if not self._file.exists():
            return []
        lines = self._file.read_text(encoding="utf-8").splitlines()
        return list({result["key"]: result for result in map(json.loads, lines)}.values())

    def run(self, mutants: Sequence[Mutant], retry: bool) -> None:
        """Try the mutants that have no result yet; with `retry` also those that survived."""
        finished = {r["key"] for r in self.results() if r["outcome"] == NOTICED or not retry}
        tiers = {tier: Covering(tier) for tier in ("default", "slow") if has_map(tier)}
        for number, mutant in enumerate(mutants, 1):
            if mutant.key in finished:
                continue
            result = _try(mutant, tiers)
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(result) + "\n")
            print(f"{number}/{len(mutants)} {mutant.key}: {result['outcome']} {result['by']}", flush=True)


def _try(mutant: Mutant, tiers: dict[str, Covering]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        top = lambda folder, _: NOT_COPIED if Path(folder) == ROOT else ()  # noqa: E731
        shutil.copytree(ROOT, copy, ignore=top, symlinks=True)
        result = {"key": mutant.key, **asdict(mutant), "difference": mutant.apply(copy)}
        for tier, covering in tiers.items():
            tests = covering.tests(mutant.module, mutant.line)
            # code that a fixture, a compiler or an import executes has no test of its own
            selected = tests or covering.tests_in(_rooms(mutant.module))
            result[tier] = len(tests)
            if selected and (by := _first_failure(copy, selected, covering)):
                return result | {"outcome": NOTICED, "tier": tier, "by": by}
    return result | {"outcome": SURVIVED, "tier": "", "by": ""}


def _rooms(module: str) -> list[str]:
    """Return the tests of a module's room: of code that a fixture or a compiler executes, not a test."""
    parts = Path(module).parts
    package = parts[1] if parts[0] == "src" else parts[2]
    more = {"src": ["tests/oracles"], "orchestration": []}[parts[0]]
    return [
        f"tests/unit/{package}",
        *more,
        *(["tests/backends"] if package in ("master", "container") else []),
    ]


def _first_failure(copy: Path, tests: Sequence[str], covering: Covering) -> str:
    """Return the first test that fails, or that takes much too long; an empty text if none does."""
    listed = copy / "selected.txt"
    listed.write_text("\n".join(tests), encoding="utf-8")
    limit = 120.0 + 4.0 * sum(covering.seconds[test] for test in tests)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(copy / n) for n in ("src", "orchestration"))
    }
    environment |= {"PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("EMLA_COSIM_CACHE", None)
    command = [
        sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "--dist", "load", "-m", "", "-p",
        "no:cacheprovider", "--tb=line", "-rfE", f"@{listed}",
    ]  # fmt: skip
    start = time.monotonic()
    process = subprocess.Popen(
        command, cwd=copy, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        output, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return f"no end after {time.monotonic() - start:.0f} s"
    if process.returncode == 0:
        return ""
    failed = [line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0][:200] if failed else output[-200:]

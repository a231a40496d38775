"""Kill commands at random moments and look at what they leave: python -m benchmarks.kills.

Each command runs in a folder of its own and gets SIGKILL at a moment drawn from its usual duration. Its
processes must end, no file may look whole and be incomplete, and the next command must remove what is left.
On Linux, run it where `/dev/shm` has only its own files:

    unshare --mount sh -c 'mount -t tmpfs none /dev/shm && python -m benchmarks.kills'
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import polars
import psutil

import emla_cosim as ec
from emla_cosim.fmu.models import MODELS, build
from tests.support.whole_files import assert_whole, assert_whole_rows

R_S = "lift.plant.motor.R_s=0.1,0.2,0.3"
SHORT_RUN = ("--stop-time", "0.01", "--no-plots", "--output", "out")

COMMANDS = {
    "run": ("run", "lift", "--stop-time", "0.5", "--output", "out"),
    "sweep": ("sweep", "lift", "--vary", R_S, "--signals", "lift.plant.x_L", *SHORT_RUN),
    "compare": ("compare", "lift", "--controllers", "rsba,foc", *SHORT_RUN),
    "tune": (
        *("tune", "lift", "--vary", "lift.controller.beta[1]=400:1600", "--evaluations", "3"),
        *("--training", "1", "--validation", "1", "--objective", "lift.position_error_m", *SHORT_RUN),
        *("--stop-time", "0.4"),
    ),
    "verify": ("verify", "Reference.fmu", "--only", "run.*", "--json", "v.json", "--html", "v.html"),
    "build": ("build", "Reference", "--output", "built"),
}
"""Commands by name; those that know it get --fmus."""

RESULTS = {
    "run": "out/results.csv",
    "sweep": "out/variants.parquet",
    "build": "built/Reference/Reference.fmu",
}
"""What must come out the same, byte for byte or value for value, when a killed command is repeated."""

END_S = 10.0
"""Seconds in which the processes of a killed command must end."""

KILLS_PER_REPEAT = 5
"""One in so many killed commands is repeated until it ends; after the others a short command cleans up."""

SHARED = Path("/dev/shm")
VARIABLE = "EMLA_KILLED"


@dataclass
class WorkingFolder:
    """A folder in which one command runs."""

    folder: Path
    fmus: Path
    mark: str
    counts: Counter[str] = field(default_factory=Counter)

    def make(self) -> None:
        """Create the folder with the user's files."""
        for name in ("temporary", "out", "cache"):
            (self.folder / name).mkdir(parents=True)
        (self.folder / "out/.mine.txt").write_text("years of work")
        shutil.copy(self.fmus / "Reference/Reference.fmu", self.folder)

    def start(self, command: Sequence[str]) -> subprocess.Popen[bytes]:
        """Start a command."""
        more = ["--fmus", str(self.fmus)] if command[0] in ("run", "sweep", "compare", "tune") else []
        cache = {"EMLA_COSIM_CACHE": str(self.folder / "cache")} if command[0] == "build" else {}
        return subprocess.Popen(
            [sys.executable, "-m", "emla_cosim", *command, *more],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, "TMPDIR": str(self.folder / "temporary"), VARIABLE: self.mark, **cache},
        )

    def processes(self) -> list[psutil.Process]:
        """Return the processes of this folder's commands."""
        processes = []
        for process in psutil.process_iter():
            try:
                if process.environ().get(VARIABLE) == self.mark and process.status() != psutil.STATUS_ZOMBIE:
                    processes.append(process)
            except psutil.Error:
                continue
        return processes

    def hidden(self) -> list[str]:
        """Return the hidden files that no complete command leaves."""
        return [
            p.name
            for folder in (self.folder, self.folder / "out", self.folder / "out/parts", self.folder / "built")
            if folder.is_dir()
            for p in folder.iterdir()
            if p.name.startswith(".") and p.name != ".mine.txt"
        ]

    def temporary(self) -> list[str]:
        """Return the temporary files."""
        return [p.name for p in (self.folder / "temporary").iterdir()]


def kill_once(name: str, working_folder: WorkingFolder, moment: float, repeat: bool) -> list[str]:
    """Kill a command, look at what it leaves, and let the next command clean up; return what is wrong."""
    wrong, shared = list[str](), list_shared()
    process = working_folder.start(COMMANDS[name])
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        process.kill()
    working_folder.counts["ended before" if process.wait() >= 0 else "killed"] += 1
    until = time.monotonic() + END_S
    while (survivors := working_folder.processes()) and time.monotonic() < until:
        time.sleep(0.05)
    for survivor in survivors:
        wrong.append(f"process {survivor.cmdline()[:6]}")
        survivor.kill()
    try:
        check_files(working_folder.folder)
    except Exception as error:
        wrong.append(f"file {error}")
    working_folder.counts["left temporary files"] += bool(working_folder.temporary())
    working_folder.counts["left hidden files"] += bool(working_folder.hidden())
    command = [*COMMANDS[name]] if repeat else ["list"]
    if repeat and name == "sweep" and (working_folder.folder / "out/sweep.json").exists():
        command.append("--resume")
    second_run = working_folder.start(command)
    output, _ = second_run.communicate()
    if second_run.returncode:
        wrong.append(
            f"next command {second_run.returncode}: {output.decode(errors='replace').strip()[-300:]}"
        )
    working_folder.counts["repeated to the end"] += repeat
    if working_folder.temporary():
        wrong.append(f"temporary {working_folder.temporary()}")
    if repeat and working_folder.hidden():
        wrong.append(f"hidden {working_folder.hidden()}")
    if (working_folder.folder / "out/.mine.txt").read_text() != "years of work":
        wrong.append("the user's file")
    if new := list_shared() - shared:
        wrong.append(f"shared memory {sorted(new)}")
    return wrong


def list_shared() -> set[str]:
    """Return the names in shared memory."""
    return {p.name for p in SHARED.iterdir()} if SHARED.is_dir() else set()


def check_files(folder: Path) -> None:
    """Raise AssertionError if a file looks whole and is not."""
    for name in ("out", "built"):
        if (folder / name).is_dir():
            copy = folder / "copy"
            shutil.rmtree(copy, ignore_errors=True)
            shutil.copytree(folder / name, copy)
            (copy / ".mine.txt").unlink(missing_ok=True)
            for table in copy.rglob("results.csv"):
                assert_whole_rows(table)
            assert_whole(copy, killed=True)
            shutil.rmtree(copy)
    for report in folder.glob("v.*"):
        assert report.read_text().rstrip().endswith(("}", "</html>")), report


def same(path: Path, content: Path) -> bool:
    """Return whether two results are the same."""
    if path.suffix == ".parquet":
        return (
            polars.read_parquet(path)
            .drop("provenance")
            .equals(polars.read_parquet(content).drop("provenance"))
        )
    return path.read_bytes() == content.read_bytes()


def main() -> None:
    """Kill, and print a row for each command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commands", nargs="*", default=list(COMMANDS))
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-") as root:
        fmus = Path(root, "fmus")
        for model in MODELS:
            build(model, "native", [], fmus)
        with ec.load("lift", stop_time=0.01, fmus=fmus).prepare() as lift:
            lift.run()  # compiles the loop
        print(
            "| Command | Killed at random moments up to | Killed | Left temporary files | Left hidden files |"
        )
        print("|---|---|---|---|---|", flush=True)
        for name in arguments.commands:
            one_command(name, Path(root), fmus, arguments.kills, random.Random(f"{arguments.seed} {name}"))


def one_command(name: str, root: Path, fmus: Path, kills: int, draw: random.Random) -> None:
    """Kill one command many times."""
    undisturbed = WorkingFolder(root / f"{name}-whole", fmus, f"{os.getpid()} {name} whole")
    undisturbed.make()
    start = time.monotonic()
    process = undisturbed.start(COMMANDS[name])
    output, _ = process.communicate()
    assert process.returncode == 0, output.decode()
    lasts = time.monotonic() - start
    counts, wrong = Counter[str](), list[str]()
    working_folder = WorkingFolder(root / name, fmus, f"{os.getpid()} {name}", counts)
    for number in range(kills):
        if number % KILLS_PER_REPEAT == 0:
            shutil.rmtree(working_folder.folder, ignore_errors=True)
            working_folder.make()
        moment = draw.uniform(0.0, lasts)
        repeat = number % KILLS_PER_REPEAT == KILLS_PER_REPEAT - 1
        problems = kill_once(name, working_folder, moment, repeat)
        if (
            repeat
            and name in RESULTS
            and not same(working_folder.folder / RESULTS[name], undisturbed.folder / RESULTS[name])
        ):
            problems.append("another result")
        wrong += [f"{name} {number} at {moment:.2f} s: {problem}" for problem in problems]
        print(f"{name} {number} {moment:.2f} s {dict(counts)} {problems or ''}", file=sys.stderr, flush=True)
    print(
        f"| `{name}` | {lasts:.1f} s | {counts['killed']} of {kills} | {counts['left temporary files']} "
        f"| {counts['left hidden files']} |",
        flush=True,
    )
    for line in wrong:
        print(line, flush=True)


if __name__ == "__main__":
    main()

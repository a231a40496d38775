"""What users add by one class: it can be chosen and is recorded wherever what we bring is."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from tests.support.commands import Emla, sentence

Array = np.ndarray
SHORT_RUN = ("--stop-time", "0.01", "--no-plots")


@dataclass(eq=False)
class Backwards(ec.Explicit):
    """Gauss-Seidel from the last instance to the first, each set some times."""

    settings: int = ec.option(1, help="How often inputs are set.", above=0, below=9, identity="settings")

    def table(self, network: Any) -> list[ec.Operation]:
        calls = [ec.Call.SET] * self.settings + [ec.Call.STEP, ec.Call.GET]
        return [ec.Operation(call, i) for i in reversed(range(len(network.instances))) for call in calls]

    def late(self) -> list[Any]:
        return [link for link in self.network.links if link.source <= link.target]

    def report(self) -> dict[str, Any]:
        return {**super().report(), "set": self.settings}


@dataclass
class Extremes(ec.Recorder):
    """Writes the largest value of a signal to a file."""

    extreme_of: str | None = ec.option(help="Signal whose largest value is kept.", record="extreme")

    def begin(self, layout: ec.RunLayout, state: Any = None) -> None:
        assert self.extreme_of is not None
        self.column, self.largest = 1 + list(layout.names).index(self.extreme_of), -np.inf

    def write(self, rows: Array) -> None:
        self.largest = max(self.largest, rows[:, self.column].max())

    def end(self) -> None:
        Path("extreme.txt").write_text(repr(float(self.largest)))


class JsonLines(ec.Table):
    """A table with one JSON array per row."""

    def __init__(self, path: Path) -> None:
        self.path, self.stream = path, None

    def begin(self, layout: ec.RunLayout, state: Any = None) -> None:
        super().begin(layout, state)
        self.path.with_suffix(".names").write_text(json.dumps(self.names))
        self.stream = self.path.open("w")

    def open(self) -> None:
        self.names = json.loads(self.path.with_suffix(".names").read_text())

    def append(self, rows: Array) -> None:
        self.stream.writelines(json.dumps(row) + "\n" for row in rows.tolist())  # type: ignore[union-attr]

    def end(self) -> None:
        super().end()
        self.stream.close()  # type: ignore[union-attr]

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Array]:
        rows = np.array([json.loads(line) for line in self.path.read_text().splitlines()])
        return {n: rows[:, self.names.index(n)] for n in names if n in self.names}


class Energy(ec.Metrics):
    """The work of every motor."""

    displays = (ec.MetricDisplay("work_J", "work", 1e-3, "kJ"),)

    def __init__(self, columns: dict[str, int]) -> None:
        self.columns, self.work, self.last = columns, dict.fromkeys(columns, 0.0), None

    def write(self, rows: Array) -> None:
        if self.last is not None:
            rows = np.vstack([self.last, rows])
        for name, column in self.columns.items():
            self.work[name] += float(np.sum(np.diff(rows[:, 0]) * rows[1:, column]))
        self.last = rows[-1].copy()

    def figures(self) -> dict[str, dict[str, float]]:
        return {name: {"work_J": work} for name, work in self.work.items()}

    def state_dict(self) -> Any:
        return {"work": self.work, "last": self.last.tolist()}  # type: ignore[union-attr]

    def load_state_dict(self, state: Any) -> None:
        self.work, self.last = state["work"], np.array(state["last"])


def energy(layout: ec.RunLayout) -> Energy | None:
    power_columns = {
        n.removesuffix(".P_el"): i + 1 for i, n in enumerate(layout.names) if n.endswith(".P_el")
    }
    return Energy(power_columns) if power_columns else None


@pytest.fixture(autouse=True)
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    import emla_cosim.cli.commands.plot
    import emla_cosim.study.loading  # noqa: F401 - the study's own come first

    monkeypatch.setitem(ec.ALGORITHMS, "backwards", Backwards)
    monkeypatch.setitem(ec.RECORDERS, "extremes", Extremes)
    monkeypatch.setitem(ec.TABLES, "jsonl", JsonLines)
    monkeypatch.setitem(ec.METRICS, "energy", energy)
    yield


def record(folder: str) -> dict[str, Any]:
    return json.loads(Path(folder, "run.json").read_text())


def test_help_shows_additions(emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    text = re.sub(r"[\s│]+", " ", emla("run", "--help").output)
    assert "jacobi, gauss-seidel, strong, backwards" in text
    assert "--settings" in text
    assert "How often inputs are set. Default: 1." in text
    assert "--extreme-of" in text
    assert "csv, parquet, jsonl" in text
    assert "backwards" in emla("list").output


def test_additions_run_from_the_command_and_from_a_file(emla: Emla) -> None:
    more = ("--algorithm", "backwards", "--settings", "2", "--extreme-of", "lift.plant.tau_m")
    result = emla("run", "lift", *SHORT_RUN, *more, "--output", "command", "--output-format", "jsonl")
    assert result.exit_code == 0, result.output
    assert "work" in result.output
    by_command = Path("extreme.txt").read_text()
    Path("my.toml").write_text(
        'system = "lift"\nstop_time = 0.01\nplots = false\nalgorithm = "backwards"\nsettings = 2\n'
        'extreme_of = "lift.plant.tau_m"\noutput = "file"\noutput_format = "jsonl"\n'
    )
    assert emla("run", "my.toml").exit_code == 0
    assert Path("extreme.txt").read_text() == by_command
    assert Path("file/results.jsonl").read_bytes() == Path("command/results.jsonl").read_bytes()
    for folder in ("command", "file"):
        record_of_run = record(folder)
        settings = record_of_run["settings"]
        assert (settings["algorithm"], settings["settings"]) == ("backwards", 2)
        assert (settings["extreme"], settings["output_format"]) == ("lift.plant.tau_m", "jsonl")
        assert record_of_run["stepping"]["set"] == 2
        metrics = json.loads(Path(folder, "metrics.json").read_text())
        assert metrics["energy"]["lift.plant"]["work_J"] > 0.0


def test_added_format_is_read_like_csv(emla: Emla) -> None:
    def run(form: str, *more: str) -> Any:
        return emla("run", "lift", *SHORT_RUN, "--output", form, "--output-format", form, *more)

    assert run("jsonl").exit_code == run("csv").exit_code == 0
    rows = {form: Path(form, f"results.{form}") for form in ("csv", "jsonl")}
    assert emla("run", "lift", *SHORT_RUN, "--reference", str(rows["jsonl"])).exit_code == 0
    assert emla("plot", "csv", "jsonl", "--signals", "lift.plant.x_L", "--overwrite").exit_code == 0
    driven = []
    for form, table in rows.items():
        more = ("--input", f"{table}:lift.plant.F_L=lift.disturbance.F_L", "--output", f"driven-{form}")
        assert emla("run", "lift", *SHORT_RUN, *more).exit_code == 0
        driven.append(Path(f"driven-{form}", "results.csv").read_bytes())
    assert driven[0] == driven[1]
    with rows["jsonl"].open("a") as stream:
        stream.write("no row\n")
    text = sentence(emla("run", "lift", *SHORT_RUN, "--reference", "jsonl"), 2)
    assert f"the run to compare with '{rows['jsonl']}' cannot be read: " in text


def test_format_without_a_reader_is_refused(emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(JsonLines, "open", ec.Table.open)
    assert emla("run", "lift", *SHORT_RUN, "--output", "o", "--output-format", "jsonl").exit_code == 0
    text = sentence(emla("plot", "o"), 2)
    assert "cannot be read: JsonLines has no method 'open'" in text


def test_algorithm_is_chosen_by_name_or_as_object(fmu_folder: Path) -> None:
    with ec.load("lift", stop_time=0.01).prepare(fmus=fmu_folder) as simulation:
        by_name = simulation.run(algorithm="backwards", settings=3)
        as_object = simulation.run(algorithm=Backwards(settings=3))
        ours = simulation.run()
        with pytest.raises(ec.CommandError, match="gauss-seidel has no settings; backwards has"):
            simulation.run(settings=3)
        with pytest.raises(ec.CommandError, match="the settings 9 must be between 0 and 9"):
            simulation.run(algorithm=Backwards(settings=9))
    assert np.array_equal(by_name["lift.plant.i_q"], as_object["lift.plant.i_q"])
    assert not np.array_equal(by_name["lift.plant.i_q"], ours["lift.plant.i_q"])
    assert by_name.stepping == as_object.stepping
    assert by_name.record["settings"]["algorithm"] == as_object.record["settings"]["algorithm"] == "backwards"


def test_step_size_control_is_chosen_by_name_or_options(fmu_folder: Path) -> None:
    error_control: Any = ec.STEP_SIZE_CONTROLS["error"]
    with ec.load("lift", stop_time=0.002).prepare(fmus=fmu_folder) as simulation:
        results = [
            simulation.run(error_tolerance=0.1),
            simulation.run(error_tolerance=0.1, step_size_control="error"),
            simulation.run(step_size_control=error_control(error_tolerance=0.1)),
        ]
        fixed = [simulation.run(), simulation.run(step_size_control="fixed")]
        with pytest.raises(ec.CommandError, match="control fixed has no error tolerance; error has"):
            simulation.run(step_size_control="fixed", error_tolerance=0.1)
        with pytest.raises(ec.CommandError, match="step-size control 'error' needs --error-tolerance"):
            simulation.run(step_size_control="error")
        with pytest.raises(ec.CommandError, match="error tolerance 2 must be between 0 and 1"):
            simulation.run(step_size_control=error_control(error_tolerance=2.0))
    for folder, name, tolerance in ((results, "error", 0.1), (fixed, "fixed", None)):
        for result in folder:
            assert np.array_equal(result["lift.plant.i_q"], folder[0]["lift.plant.i_q"])
            settings = result.record["settings"]
            assert (settings["step_size_control"], settings["error_tolerance"]) == (name, tolerance)
    assert len(results[0].time) != len(fixed[0].time)


def test_checkpoints_contain_additions(emla: Emla) -> None:
    def run(settings: str, *more: str) -> Any:
        options = ("--algorithm", "backwards", "--settings", settings, "--no-plots")
        return emla("run", "lift", *options, *more)

    assert run("2", "--stop-time", "0.01", "--checkpoint", "c").exit_code == 0
    text = sentence(run("3", "--stop-time", "0.02", "--resume", "c"), 2)
    assert "has the settings 2, but this run has 3" in text
    assert run("2", "--stop-time", "0.02", "--resume", "c").exit_code == 0
    parts = json.loads(Path("results/lift/metrics.json").read_text())["energy"]
    assert run("2", "--stop-time", "0.02").exit_code == 0
    expected = json.loads(Path("results/lift/metrics.json").read_text())["energy"]
    assert parts["lift.plant"]["work_J"] == pytest.approx(expected["lift.plant"]["work_J"], rel=1e-12)

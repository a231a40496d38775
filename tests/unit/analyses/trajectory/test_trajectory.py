"""`emla trajectory` and `ec.trajectory` write the optimal motion, draw it and refuse invalid problems."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import BSpline

import emla_cosim as ec
from emla_cosim.analyses.trajectory import runner
from emla_cosim.analyses.trajectory.problem import describe_problem, load_problem, paper_problem
from emla_cosim.analyses.trajectory.report import PICTURES
from emla_cosim.base.progress import Progress
from emla_cosim.cli.app import app
from emla_cosim.system.model import System
from machine_fmu.spline import DEFAULT_FILE, default_spline
from tests.support.commands import Emla, sentence, widen_terminal
from tests.support.manipulator_geometry import HDRM, points

COARSE = ("--knots", "10", "--points", "5")
FAST: dict[str, Any] = {"knots": 10, "points": 5}


@pytest.fixture
def emla(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Emla:
    """Run `emla` in an empty folder; nothing here needs an FMU."""
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch, 200)
    return lambda *arguments: CliRunner().invoke(app, list(arguments))


@pytest.fixture(scope="module")
def coarse() -> ec.TrajectoryResult:
    return ec.trajectory(**FAST)


# ---- what comes out ----------------------------------------------------------------------------


@pytest.mark.slow
def test_command_reports_and_writes_the_motion(emla: Emla, tmp_path: Path) -> None:
    output = emla("trajectory", *COARSE, "--output", "motion.json")
    assert output.exit_code == 0, output.output
    for words in (
        "The problem contradicts itself: v_E[3] = -0.5477 m/s",
        "replaced by the bound (--end-speed clip)",
        "cost J as printed",
        "lower bound",
        "gross work",
        "of 89.8",
        "iterations in",
        "All bounds hold on the dense grid.",
        "Wrote motion.json, motion-forces-and-speeds.png, motion-positions-and-accelerations.png",
    ):
        assert words in output.stdout, words
    names = ["motion.json", *(f"motion-{name}.png" for name in PICTURES)]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    for name in names[1:]:
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_pictures_and_page_of_the_motion_before_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "motion.json"
    ec.trajectory(**FAST, output=path, report=True)
    assert len([*tmp_path.iterdir()]) == 2 + len(PICTURES)
    (tmp_path / f"motion-{PICTURES[0]}.png").write_text("mine")
    ec.trajectory(**FAST, output=path, plots=False)
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"motion-{PICTURES[0]}.png", "motion.json"]


def test_file_can_be_read_with_scipy(coarse: ec.TrajectoryResult, tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    coarse.save(file)
    document = json.loads(file.read_text(encoding="utf-8"))
    assert ec.read_trajectory(str(file)) == coarse.spline
    curve = BSpline(document["knots"], document["coefficients"]["tilt"], document["degree"])
    times = np.linspace(0.0, document["knots"][-1], 50)
    assert curve(times) == pytest.approx(coarse.course(times).q[:, 1], rel=1e-12)
    assert document["problem"]["v_E"] == [0.0607, -0.0808, -0.5477]
    assert document["problem"]["machine"]["lift.a"] == 1.15
    assert document["problem"]["machine"]["file"] == "hdrm"
    assert document["end_speed"] == "clip"
    assert document["figures"]["cost"] == coarse.assessment.cost
    expected = {"degree": 5, "knots": 10, "points": 5, "tie_break": 1e-3, "subdivisions": 1}
    assert document["discretisation"] == expected
    assert {"casadi", "emla-cosim"} <= document["versions"].keys()


def test_file_in_the_package_has_default_settings() -> None:
    content, options = json.loads(DEFAULT_FILE.read_text(encoding="utf-8")), paper_problem()
    assert content["problem"]["v_E"] == list(options.v_E)
    assert content["problem"]["machine"]["motor_m"] == [
        options.machine.machine.parameters[f"motor.m[{i}]"].value for i in (1, 2, 3)
    ]
    expected = {"degree": 5, "knots": 20, "points": 10, "tie_break": 1e-3, "subdivisions": 1}
    assert content["discretisation"] == expected
    assert ec.read_trajectory(DEFAULT_FILE) == default_spline()


def test_several_starts_report_progress() -> None:
    class Counting(Progress):
        def __init__(self) -> None:
            self.tasks, self.count = list[str](), 0

        def begin(self, task: str, total: int, unit: str = "") -> None:
            self.tasks.append(task)

        def advance(self, count: int) -> None:
            self.count += count

    progress = Counting()
    result = ec.trajectory(**FAST, starts=2, progress=progress)
    assert progress.tasks == ["start 1", "start 2"]
    assert progress.count >= result.solution.iterations > 5
    assert result.starts == 2


def test_pictures_show_the_motion(coarse: ec.TrajectoryResult) -> None:
    figures = coarse.plot()
    forces = figures["forces-and-speeds"].axes
    assert [a.get_ylabel() for a in forces[::3]] == ["force / kN", "speed / mm/s"]
    assert [a.get_title() for a in forces[:3]] == ["lift", "tilt", "telescope"]
    peak = np.abs(np.asarray(forces[0].lines[0].get_ydata())).max()
    assert peak == pytest.approx(abs(coarse.assessment.peaks[0].force) / 1e3, rel=2e-2)
    positions = figures["positions-and-accelerations"].axes
    assert [a.get_ylabel() for a in positions[::3]] == ["stroke / m", "acceleration / mm/s²", "jerk / mm/s³"]
    assert np.asarray(positions[1].lines[0].get_ydata())[[0, -1]] == pytest.approx([0.389, 0.442])
    path = {line.get_label(): np.column_stack(line.get_data()) for line in figures["path"].axes[0].lines}
    for row, q in ((0, coarse.problem.q_S), (-1, coarse.problem.q_E)):
        at = points(HDRM, q)["tip"]
        assert path["path of the tip"][row] == pytest.approx([at.real, at.imag])
    assert path["clearance"][0, 1] == pytest.approx(-1.381 + 0.2, abs=1e-3)


def solve(emla: Emla, *arguments: str) -> tuple[str, dict[str, Any]]:
    """Run the command; return what it prints, and the problem in m.json."""
    output = emla("trajectory", *arguments, *COARSE, "--no-plots", "--output", "m.json")
    assert output.exit_code == 0, output.output
    return output.stdout, json.loads(Path("m.json").read_text(encoding="utf-8"))


def test_acceleration_bounds(emla: Emla) -> None:
    limits = ("--set", "a_LB=-0.1,-0.1,-0.1", "--set", "a_UB=0.1,0.1,0.1")
    stdout, document = solve(emla, *limits, "--set", "a_UB[2]=0.2")
    assert "of 200" in stdout and "of -100" in stdout and "mm/s³" in stdout
    assert document["problem"]["a_UB"] == [0.1, 0.2, 0.1] and document["problem"]["j_UB"] is None
    assert max(abs(peak["acceleration"]) for peak in document["figures"]["peaks"]) <= 0.2 * (1.0 + 1e-6)
    result = ec.trajectory({"a_LB": [-0.1] * 3, "a_UB": [0.1, 0.2, 0.1], "j_UB": "off"}, **FAST)
    assert result.spline == ec.read_trajectory("m.json")
    tilt = result.plot()["positions-and-accelerations"].axes[4]
    assert [np.asarray(line.get_ydata())[0] for line in tilt.lines[1:]] == pytest.approx([-100.0, 200.0])


# ---- another problem ---------------------------------------------------------------------------


def test_problem_as_file_options_and_python_values(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("payload = 200\nt_M = 20\nground = -1.7\n[machine]\nlift_a = 1.2\n")
    changes = ("--set", "q_E[3]=0.4", "--set", "v_E=0,0,0", "--set", "machine.tilt_b=0.46")
    stdout, _ = solve(emla, "mine.toml", *changes)
    assert "contradicts" not in stdout
    problem = {"payload": 200.0, "t_M": 20.0, "ground": -1.7, "q_E": [0.270, 0.442, 0.4], "v_E": np.zeros(3)}
    result = ec.trajectory(problem | {"machine": {"lift_a": 1.2, "tilt_b": 0.46}}, **FAST)
    assert result.spline.end == 20.0
    assert result.spline == ec.read_trajectory(tmp_path / "m.json")
    assert result.problem.machine.machine.parameters["lift.a"].value == 1.2


def test_the_record_of_a_problem_is_a_problem() -> None:
    problem = load_problem({"machine": {"file": "lift_table", "screw.L_0[1]": 0.55}, "q_E": 0.2, "t_M": 8.0})
    reloaded = load_problem(
        json.loads(json.dumps({k: x for k, x in describe_problem(problem).items() if x is not None}))
    )
    assert reloaded.machine.machine == problem.machine.machine
    assert describe_problem(reloaded) == describe_problem(problem)
    assert (reloaded.v_UB, reloaded.f_LB) == (problem.v_UB, problem.f_LB) and problem.v_UB == (0.1,)


@pytest.mark.slow
def test_tip_positions_as_file_options_and_python_values(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("tip_E = [3.2, 0.4]\n[[via]]\ntip = [2.7, -0.4]\n")
    changes = ("--set", "tip_E=3.2,0.5", "--set", "via[1].at=0.3", "--set", "via[2].tip=3,0.2")
    _, document = solve(emla, "mine.toml", *changes, "--end-speed", "rest")
    assert document["problem"]["tip_E"] == [3.2, 0.5]
    assert [via["tip"] for via in document["problem"]["via"]] == [[2.7, -0.4], [3, 0.2]]
    assert [via["at"] for via in document["problem"]["via"]] == [0.3, None]
    problem = {"tip_E": np.array([3.2, 0.5]), "via": [{"tip": [2.7, -0.4], "at": 0.3}, {"tip": (3.0, 0.2)}]}
    result = ec.trajectory(problem, end_speed="rest", **FAST)
    assert result.spline == ec.read_trajectory(tmp_path / "m.json")


def test_changing_payload_is_written_for_scenarios(emla: Emla, fmu_folder: Path, tmp_path: Path) -> None:
    changes = ("--set", "via[1].tip=3,-0.6", "--set", "via[1].payload=50", "--set", "t_M=20")
    changes = (*changes, "--end-speed", "rest")
    stdout, _ = solve(emla, *changes)
    assert "replaced by rest for all joints (--end-speed rest)" in stdout.replace("\n", " ")
    assert ec.read_trajectory("m.json").evaluated([20.0], 1)[0] == pytest.approx(np.zeros(3), abs=1e-9)
    assert "Wrote m.json, m-payload.csv" in stdout
    lines = (tmp_path / "m-payload.csv").read_text().splitlines()
    assert lines[1:] == ["time [s],payload [kg]", "0.0,470.0", "10.0,50.0"]
    (tmp_path / "m-payload.csv").write_text("mine\n")
    assert "was not written by emla" in emla("trajectory", *changes, *COARSE, "--output", "m.json").output
    times = ("--start-time", "9.9995", "--stop-time", "10.0005", "--fmus", str(fmu_folder))
    noted = emla("run", "hdrm-coupled", "--trajectory", "m.json", *times, "--output", "r", "--no-plots")
    assert "its payload changes; use --input NAME-payload.csv:machine.manipulator.payload.m" in noted.output


# ---- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--end-speed", "never"), "there is no reading of end speeds 'never'; choose from clip, exempt"),
        (("--knots", "45"), "knots is 45; with degree 5, it must be a whole number from 2 to 44"),
        (("--knots", "3", "--degree", "3"), "knots is 3; with degree 3, it must be a whole number from 4 to"),
        (("--degree", "6"), "degree is 6; it must be a whole number from 3 to 5"),
        (("--subdivisions", "65"), "subdivisions is 65; it must be a whole number from 1 to 64"),
        (("--points", "1"), "points is 1; it must be a whole number from 3 to 50"),
        (("--starts", "0"), "starts is 0; it must be a whole number from 1 to 100"),
        (("--tie-break", "-1"), "the tie-break weight is -1; it must be from 0 to 1000"),
        (("--set", "t_M"), "--set t_M has no name or no value"),
        (("--set", "tM=3"), "a problem has no 'tM'; did you mean t_M"),
        (("--set", "machine.lift=3"), "did you mean machine.lift.b or machine.lift.a"),
        (("--set", "machine.x.y=3"), "a problem has no 'machine.x.y'"),
        (("--set", "q_E[4]=3"), "'q_E[4]' = 3; the index is too large: q_E has 3 numbers"),
        (("--set", "t_M[1]=3"), "'t_M[1]' = 3; an element must be one of several numbers"),
        (("--set", "via[2].tip=3,0"), "via[2] has no predecessor; the next way-point is via[1]"),
        (("--set", "via[1].at=0.3"), "lacks tip; write tip = [..., ...]"),
        (("--set", "via[1].tipp=0.3"), "unknown entry 'tipp'; did you mean 'tip'?"),
        (("--set", "tip_E=0.3"), "tip_E is 0.3; it must be two finite numbers: x, y, or off"),
        (("--set", "tip_E=5,1"), "tip_E = 5,1 m is out of the tip's reach by 0.674 m"),
        (("--set", "a_UB=nan"), "a_UB is nan; it must be three finite numbers: lift, tilt, telescope, or"),
        (("--set", "ground_clearance=-1"), "ground_clearance is -1; it must be 0 m or more, or off"),
        (("--set", "ground_clearance=inf"), "ground_clearance is inf; it must be a finite number, or off"),
        (("--set", "a_UB[3]=1"), "'a_UB[3]' = 1; a_UB has no values yet: write all of them, a_UB=1,1,1"),
        (("--set", "t_M=off"), "t_M is 'off'; it must be a finite number"),
        (("--set", "q_E=3"), "q_E is 3.0; it must be three finite numbers"),
        (("--set", "q_E=a,b,c"), "'q_E' = a,b,c; it must be a number in SI units, or several with commas"),
        (("--set", "t_M=inf"), "t_M is inf; it must be a finite number"),
        (("--set", "t_M=0"), "t_M is 0; it must be more than 0 s"),
        (("--set", "payload=-1"), "payload is -1; it must be 0 kg or more"),
        (("--set", "machine.lift_a=1,2,3"), "'lift_a' in [machine] of the problem is [1.0, 2.0, 3.0]"),
        (("--set", "machine.lift_a=-1"), "[machine] of the problem: lift.a = -1 is outside its range"),
        (("--set", "machine.lift_L_0=9"), "cannot close"),
        (("--set", "q_E[1]=0.9"), "the problem contradicts itself: q_E[1] = 0.9 m of the lift is beyond"),
        (("crane", "--set", "q_E=1,1,1"), "the problem of the machine 'crane' lacks t_M; lists have a"),
        (("cran",), "there is no machine 'cran'; choose from crane, excavator"),
        (("--set", "machine=own.toml"), "the machine 'own.toml' cannot be read"),
        (("--set", "obstacles[1].radius=1"), "an obstacle has radius; it must have centre and radius"),
        (("nowhere.toml",), "the problem 'nowhere.toml' cannot be read"),
        (("text.toml",), "the problem 'text.toml' is not TOML"),
        (("names.toml",), "the problem 'names.toml' has the unknown entry 'q_e'; did you mean 'q_E'?"),
        (("flat.toml",), "'machine' of the problem 'flat.toml' is 3; it must be the name or file"),
        (("texts.toml",), "'lift_a' in [machine] of the problem 'texts.toml' is 'x'; it must be a number"),
        (("--output", "there/x.json"), "the trajectory 'there/x.json' cannot be written: there is no folder"),
        (("--output", "folder"), "the trajectory 'folder' cannot be written: it is a folder"),
        (("--output", "x.png"), "the trajectory 'x.png' must not end in .png"),
        (("good.toml", "--output", "good.toml"), "the trajectory 'good.toml' is also the problem"),
    ],
)
def test_invalid_problems_give_one_message(
    arguments: tuple[str, ...], words: str, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "solved", None)
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.toml").write_text("no toml")
    (tmp_path / "names.toml").write_text("q_e = [1, 2, 3]\n")
    (tmp_path / "flat.toml").write_text("machine = 3\n")
    (tmp_path / "texts.toml").write_text('[machine]\nlift_a = "x"\n')
    (tmp_path / "good.toml").write_text("t_M = 20\n")
    before = sorted(tmp_path.iterdir())
    output = () if "--output" in arguments else ("--output", "m.json")
    assert words in sentence(emla("trajectory", *arguments, *output), 2)
    assert sorted(tmp_path.iterdir()) == before


def test_infeasible_problem_names_the_bounds(emla: Emla, tmp_path: Path) -> None:
    text = sentence(emla("trajectory", *COARSE, "--set", "t_M=0.72", "--output", "m.json"), 1)
    assert "no motion keeps all bounds" in text
    assert "the speed bounds of the telescope by" in text
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "the trajectory 'm.json' cannot be read: No such file or directory"),
        (b"\xff\xfe", "is not a text in UTF-8"),
        (b"{", "the trajectory 'm.json' is not JSON"),
        (b"[" * 100_000, "the trajectory 'm.json' is not JSON"),
        (b'{"degree": ' + b"9" * 5000 + b"}", "is not JSON"),
        (b"[]", "the trajectory 'm.json' cannot be used: it must be a JSON object"),
        (b'{"degree": 5, "knots": [NaN], "coefficients": {}}', "number 1 of the knots is nan"),
    ],
)
def test_invalid_trajectory_files_are_refused(
    content: bytes | None, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path("m.json").write_bytes(content)
    with pytest.raises(ec.CommandError, match=words):
        ec.read_trajectory("m.json")


def test_failed_search_keeps_the_earlier_file(
    coarse: ec.TrajectoryResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    coarse.save("m.json")
    before = Path("m.json").read_bytes()
    with pytest.raises(ec.RunError, match="no motion keeps all bounds"):
        ec.trajectory({"t_M": 0.72}, **FAST, output="m.json")
    assert Path("m.json").read_bytes() == before
    os.mkfifo("pipe")
    with pytest.raises(ec.CommandError, match="it is a pipe"):
        coarse.save("pipe")


def test_interrupt_ends_the_search(tmp_path: Path) -> None:
    class Impatient(Progress):
        def advance(self, count: int) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ec.trajectory(**FAST, progress=Impatient(), output=tmp_path / "m.json")
    assert not list(tmp_path.iterdir())


def test_motion_of_another_machine_is_reported(tmp_path: Path) -> None:
    def note(system: System) -> str:
        note = system.component("machine.trajectory").note
        return note(system) if callable(note) else note

    document = json.loads(DEFAULT_FILE.read_text(encoding="utf-8"))
    (tmp_path / "same.json").write_text(json.dumps(document))
    document["problem"]["via"] = [{"payload": 50.0}]
    (tmp_path / "changing.json").write_text(json.dumps(document))
    document["problem"]["via"] = [{"payload": None}]
    document["problem"]["payload"] = 200.0
    document["problem"]["machine"]["motor_m"][1] = 35.0
    (tmp_path / "other.json").write_text(json.dumps(document))
    del document["problem"]
    (tmp_path / "bare.json").write_text(json.dumps(document))
    for scenario, machine in (("hdrm-replay", "machine.manipulator"), ("hdrm-merged", "machine.plant")):
        systems = {
            n: ec.load(scenario, trajectory=tmp_path / f"{n}.json").system
            for n in ("same", "other", "bare", "changing")
        }
        assert note(systems["same"]) == note(systems["bare"]) == note(ec.load(scenario).system) == ""
        text = note(systems["other"])
        assert f"{machine}.payload.m is 470 kg, but 200 kg there" in text
        assert "motor.m[2] is 30 kg, but 35 kg there." in text and text.count(";") == 1
        assert f"-payload.csv:{machine}.payload.m=payload,interpolation=held" in note(systems["changing"])
        changed = systems["other"].with_parameters({f"{machine}.payload.m": 200.0})
        assert "payload" not in note(changed) and "motor.m[2]" in note(changed)
        heavier = systems["same"].with_parameters({f"{machine}.payload.m": 500.0})
        assert "payload.m is 500 kg, but 470 kg there" in note(heavier)

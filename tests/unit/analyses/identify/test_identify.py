"""`identify` and `emla identify` estimate the same as SciPy, refuse invalid data and write their files."""

import json
import re
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from distributed import Client
from scipy.optimize import least_squares

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.base.progress import Progress
from fmublock import Block, Input, Output, Parameter, State, build, sin
from tests.support.commands import Emla, sentence
from tests.support.hand_written_fmus import build_reluctant_fmu
from tests.support.toy_fmu import PRODUCER


class Cart(Block):
    """A cart on a rail, pushed by a force, with viscous and quadratic drag and a spring."""

    F = Input(unit="N", description="Force")
    m = Parameter(2.0, unit="kg", minimum=0.01, description="Mass")
    b = Parameter(1.0, unit="N.s/m", description="Viscous drag")
    c = Parameter(0.0, unit="N.s2/m2", description="Quadratic drag")
    k = Parameter(0.0, unit="N/m", description="Spring")
    idle = Parameter(1.0, description="Nothing")
    gain = Parameter(1.0, description="Gain of the force")
    x = State(0.0, unit="m", description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    P = Output(unit="W", description="Power")

    def derivatives(self, v: Any) -> dict[str, Any]:
        drag = v.b * v.v + v.c * v.v * abs(v.v) + v.k * v.x
        return {"x": v.v, "v": (v.gain * v.F - drag) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"P": v.F * v.v}


pytestmark = pytest.mark.usefixtures("on_one_cluster")

TIME = np.linspace(0.0, 2.0, 201)
FORCE = 3.0 * np.sign(np.sin(5.0 * TIME)) + TIME
TRUE = {"m": 1.3, "b": 0.7, "c": 0.4}
STEP = 2e-3


def lines(force: np.ndarray) -> list[tuple[float, float]]:
    """The force at begin and end of each step: data are known in advance."""
    return list(pairwise(np.interp(np.linspace(0.0, 2.0, round(2.0 / STEP) + 1), TIME, force).tolist()))


def hold_steps(force: np.ndarray) -> list[tuple[float, float]]:
    """The force of each step, if it is held."""
    return [(x, x) for x in force.tolist()]


LINES = lines(FORCE)


def motion(
    m: float, b: float, c: float, forces: list[tuple[float, float]] = LINES, step: float = STEP
) -> np.ndarray:
    """Positions at the samples, by the classical Runge-Kutta method."""

    def slope(y: np.ndarray, force: float) -> np.ndarray:
        return np.array([y[1], (force - b * y[1] - c * y[1] * abs(y[1])) / m])

    rows = [np.zeros(2)]
    for begin, end in forces:
        k1 = slope(rows[-1], begin)
        k2 = slope(rows[-1] + 0.5 * step * k1, 0.5 * (begin + end))
        k3 = slope(rows[-1] + 0.5 * step * k2, 0.5 * (begin + end))
        k4 = slope(rows[-1] + step * k3, end)
        rows.append(rows[-1] + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return np.array(rows)[:: round(0.01 / step), 0]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cart") / "cart.fmu"
    build(Cart, path, producer=PRODUCER)
    return path


def noisy(sigma: float = 1e-3, seed: int = 4, **changed: float) -> np.ndarray:
    return motion(**(TRUE | changed)) + sigma * np.random.default_rng(seed).standard_normal(len(TIME))


def data(x: np.ndarray, force: np.ndarray = FORCE) -> dict[str, Any]:
    """The options of an experiment: its force, and its measured positions."""
    return {
        "input": [ec.Input(data={"time": TIME, "F": force}, signals={"Cart.F": "F"})],
        "measured": [ec.Input(data={"time": TIME, "x": x}, signals={"Cart.x": "x"})],
    }


RUN: dict[str, Any] = {"stop_time": 2.0, "step_size": STEP}
RANGES = {"Cart.m": "0.2:10", "Cart.b": "0:5", "Cart.c": "0:5"}

Identify = Callable[..., ec.IdentificationResult]


@pytest.fixture(scope="module")
def identify(fmu: Path, scheduler: Client) -> Identify:
    return partial(ec.identify, str(fmu), scheduler=scheduler, **RUN)


def test_estimates_and_errors_equal_those_of_scipy(identify: Identify) -> None:
    x = noisy()
    result = identify(RANGES, **data(x))
    expected = least_squares(
        lambda p: motion(*p) - x, [1.5, 0.8, 0.5], "3-point", diff_step=1e-3, xtol=1e-12, ftol=1e-12
    )
    variance = 2.0 * expected.cost / (len(x) - 3)
    errors = np.sqrt(np.diag(variance * np.linalg.inv(expected.jac.T @ expected.jac)))
    for name, value, error in zip(RANGES, expected.x, errors, strict=True):
        estimate = result[name]
        assert estimate.value == pytest.approx(value, abs=0.05 * error)
        assert estimate.error == pytest.approx(error, rel=0.2) and estimate.problem is None
        assert estimate.interval is not None and estimate.interval[0] < TRUE[name[-1]] < estimate.interval[1]
    (fit,) = result.fits
    assert fit.rms == pytest.approx(np.sqrt(2.0 * expected.cost / len(x)), rel=1e-3)
    assert fit.is_white and fit.related_input is None and not fit.outliers
    assert result.notes == []
    assert result.is_identified and result.converged
    assert result.sigma["Cart.x"] == pytest.approx(fit.rms, rel=0.03)


def test_stop_time_defaults_to_the_end_of_the_measurement(
    fmu: Path, identify: Identify, scheduler: Client
) -> None:
    """Data for inputs need a stop time; without any it is that of the measured data."""
    options = {"set": {"Cart.b": TRUE["b"], "Cart.c": TRUE["c"]}, **data(noisy())}
    ranges = {"Cart.m": "0.2:10"}
    system = ec.System.of({"Cart": fmu})
    result = ec.identify(system, ranges, scheduler=scheduler, step_size=STEP, **options)
    assert result.samples["time"].max() == 2.0
    assert result["Cart.m"].value == identify(ranges, **options)["Cart.m"].value


def wave(time: np.ndarray) -> np.ndarray:
    """The force of `Wave` in N."""
    return 4.0 * np.sin(6.0 * time)


class Wave(Block):
    """A force that is computed, so that it is not known in advance."""

    F = Output(unit="N", description="Force")

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": 4.0 * sin(6.0 * v.time)}


@pytest.fixture(scope="module")
def driven(fmu: Path) -> ec.System:
    return ec.System.of({"wave": Wave, "Cart": fmu}, ["wave.F -> Cart.F"])


def fitted(x: np.ndarray, step: float) -> np.ndarray:
    """Estimates of SciPy with the force of the end of each step."""
    forces = hold_steps(wave(step * np.arange(1, round(2.0 / step) + 1)))
    return least_squares(
        lambda p: motion(*p, forces, step) - x, list(TRUE.values()), "3-point", xtol=1e-12, ftol=1e-12
    ).x


def test_change_by_half_the_step_equals_that_of_another_fit(
    driven: ec.System, identify: Identify, scheduler: Client
) -> None:
    fine = 1e-4
    force = wave(fine * (np.arange(round(2.0 / fine)) + 0.5))
    x = motion(**TRUE, forces=hold_steps(force), step=fine) + 2e-4 * np.random.default_rng(7).standard_normal(
        len(TIME)
    )
    measured = [ec.Input(data={"time": TIME, "x": x}, signals={"Cart.x": "x"})]
    options: dict[str, Any] = {**RUN, "measured": measured, "scheduler": scheduler}
    result = ec.identify(driven, RANGES, **options)
    changes = [result[name].step_change for name in RANGES]
    moves = fitted(x, 0.5 * STEP) - fitted(x, STEP)
    errors = [result[name].error for name in RANGES]
    assert changes == pytest.approx([a / b for a, b in zip(moves, errors, strict=True)], rel=0.05, abs=0.02)
    assert max(map(abs, changes)) > 1.5
    (note,) = (note for note in result.notes if "the step, not the machine" in note)
    suggested = re.search(r"--step-size (\S+) or --extrapolation fmu", note)
    assert suggested is not None
    for remedy in ({"step_size": float(suggested[1])}, {"extrapolation": "fmu"}):
        better = ec.identify(driven, RANGES, **{**options, **remedy})
        assert all(abs(better[name].step_change) < 1.0 for name in RANGES), remedy
        assert not any("the step" in note for note in better.notes)


@pytest.mark.slow
def test_step_that_is_not_judged_has_a_reason(driven: ec.System, scheduler: Client) -> None:
    """An exact fit has no standard errors worth the name; half a controlled step is none."""
    forces = hold_steps(wave(STEP * np.arange(1, round(2.0 / STEP) + 1)))
    exact = motion(**TRUE, forces=forces)
    wrong = exact + 1e-4 * np.random.default_rng(1).standard_normal(len(TIME))
    for x, options, reason in (
        (exact, {}, "the fit is exact"),
        (wrong, {"error_tolerance": 1e-3}, "the step size is controlled"),
    ):
        measured = [ec.Input(data={"time": TIME, "x": x}, signals={"Cart.x": "x"})]
        result = ec.identify(driven, RANGES, measured=measured, scheduler=scheduler, **{**RUN, **options})
        assert result["Cart.m"].step_change is None and result.complete
        assert any(note.startswith(f"the step is not judged: {reason}") for note in result.notes)


def test_incomplete_model_is_reported_and_fails_on_other_data(identify: Identify) -> None:
    second_force = 4.0 * np.sin(2.0 * TIME)
    held_out = data(motion(**TRUE, forces=lines(second_force)), second_force)
    second = ec.Experiment("second", held_out["measured"], {"input": held_out["input"]}, held_out=True)
    without = {name: RANGES[name] for name in ("Cart.m", "Cart.b")}
    x = noisy()
    for vary, good in ((RANGES, True), (without, False)):
        result = identify(vary, experiments=[second], **data(x))
        first, last = result.fits
        assert last.held_out and last.samples == len(TIME)
        assert first.is_white == good and (last.fit > 0.999) == good
        assert any("the model lacks something" in note for note in result.notes) != good
        assert not any("second" in note for note in result.notes)


def test_held_out_experiments_run_once(identify: Identify) -> None:
    first = data(noisy())
    second = ec.Experiment("second", first["measured"], {"input": first["input"]}, held_out=True)
    options = {"sigma": {"Cart.x": 1e-3}, **first}
    single, pair = (identify({"Cart.m": "0.2:10"}, experiments=more, **options) for more in ([], [second]))
    assert pair.runs == single.runs + 1 and pair.set == single.set


@pytest.mark.slow
def test_unidentifiable_parameters_have_a_problem(identify: Identify) -> None:
    vary = {"Cart.m": "0.2:10", "Cart.b": "0:5", "Cart.idle": "0:2", "Cart.gain": "0.1:10"}
    result = identify(vary, **data(noisy(c=0.0)))
    assert result["Cart.idle"].problem == "it has no influence on the measured signals"
    for name in ("Cart.m", "Cart.b", "Cart.gain"):  # the whole equation times a factor
        assert "do not tell it from a combination of" in str(result[name].problem), result[name]
    assert not result.is_identified and np.isnan(result.correlations).all()


def test_sensors_are_estimated_with_the_model(identify: Identify) -> None:
    clean = motion(1.3, 0.7, 0.0)
    late = 0.02 + 1.05 * np.interp(TIME - 0.03, TIME, clean)
    x = late + 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))
    vary = {"Cart.m": "0.2:10", "Cart.b": "0:5", "offset(Cart.x)": "-10cm:10cm", "delay(Cart.x)": "0:100ms"}
    options = data(x / 1.05 + 0.02 * (1 - 1 / 1.05))
    result = identify(vary, sigma={"Cart.x": "0.1 mm"}, **options)
    assert result["offset(Cart.x)"].value == pytest.approx(0.02, abs=2e-4)
    assert result["delay(Cart.x)"].value == pytest.approx(0.03, abs=1e-3)
    assert result["Cart.m"].value == pytest.approx(1.3, rel=0.02)
    assert "offset(Cart.x)" not in result.set and set(result.set) == {"Cart.m", "Cart.b"}


def test_experiments_are_ranked_by_information(identify: Identify) -> None:
    def experiment(name: str, force: np.ndarray) -> ec.Experiment:
        return ec.Experiment(name, (), {"input": data(FORCE, force)["input"]})

    forces = {"still": 1e-9 * FORCE, "weak": 0.1 * FORCE, "strong": FORCE}
    planned = [experiment(name, force) for name, force in forces.items()]
    vary = {"Cart.m": "0.5:4", "Cart.b": "0.1:5"}
    result = identify(vary, experiments=planned, sigma={"Cart.x": 1e-3}, design=True)
    assert [candidate.experiment for candidate in result.candidates] == ["strong", "weak", "still"]
    strong, weak, _ = result.candidates
    for name in vary:  # a linear model: ten times the force, a tenth of the error
        assert weak.intervals[name] == pytest.approx(10.0 * strong.intervals[name], rel=1e-3)
    assert strong.information - weak.information == pytest.approx(4.0 * np.log2(10.0), rel=1e-3)
    start = {"m": 2.0, "b": 1.0, "c": 0.0}

    def derivative(name: str) -> np.ndarray:
        up, down = ({**start, name: start[name] + sign * 1e-3} for sign in (1, -1))
        return (motion(**up) - motion(**down)) / 2e-3 / 1e-3

    columns = np.column_stack([derivative("m"), derivative("b")])
    errors = 1.96 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    rows = (2.0 / STEP + 1) / 201  # a planned experiment has a sample for each row of its table
    assert [strong.intervals[n] for n in vary] == pytest.approx(errors / np.sqrt(rows), rel=0.05)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"vary": {}}, "has no unknown parameter"),
    ({"vary": {"Cart.m": "2"}}, "'Cart.m' of .* needs a range LOW:HIGH"),
    ({"vary": {"Cart.mass": "1:2"}}, "Cart has no variable 'mass'"),
    ({"vary": {"Cart.P": "1:2"}}, "computed by the FMU"),
    ({"vary": {"offset(Cart.v)": "0:1"}}, "Cart.v is not measured"),
    ({"x": np.zeros(201)}, "does not vary: it has no information on Cart.x"),
    ({"x": np.where(TIME == 1.0, np.nan, FORCE)}, "must be a finite number"),
    ({"signals": {"Cart.y": "x"}}, "Cart has no variable 'y'"),
    ({"signals": {"Cart.x": "y"}}, "has no column 'y'"),
    ({"signals": {"Cart.x": ec.Column("x", unit="kN")}}, "cannot be converted into each other"),
    ({"times": [0.0, 1.0]}, "has 2 samples for 3 parameters"),
    ({"times": TIME + 5.0}, "has fewer than two samples between"),
    ({"loss": "square"}, "loss 'square'"),
    ({"vary": {"stop_time": "1:2"}}, "stop_time is not a start value"),
    ({"sigma": {"Cart.v": 1.0}}, "Cart.v in 'sigma' of .* is not measured"),
    ({"signals": {"Cart.x": ec.Column("x", derivative=1)}}, "derivative"),
    ({"settings": {"end": "repeat"}}, "has end=repeat, which only data for inputs have"),
    ({"signals": {}, "settings": {"columns": ["speed*"]}}, "has no column 'speed\\*'"),
    ({"signals": {}, "names": ("t", "place")}, "no column with the name of a signal"),
    ({"profile": ["Cart.m"], "loss": "huber"}, "a profile needs 'linear'"),
    ({"profile": ["Cart.k"]}, "'Cart.k' in 'profile'"),
    ({"sigma": {"Cart.x": -1}}, "must be positive"),
]


@pytest.mark.parametrize(("changed", "message"), BAD)
def test_invalid_requests_are_refused(changed: dict[str, Any], message: str, identify: Identify) -> None:
    options = dict(changed)
    times = np.asarray(options.pop("times", TIME))
    x = np.asarray(options.pop("x", FORCE))[: len(times)]
    signals, settings = options.pop("signals", {"Cart.x": "x"}), options.pop("settings", {})
    names = options.pop("names", ("time", "x"))
    measured = ec.Input(data=dict(zip(names, (times, x), strict=True)), signals=signals, **settings)
    vary = options.pop("vary", RANGES)
    with pytest.raises(CommandError, match=message):
        identify(vary, measured=[measured], **options)


@pytest.mark.slow
def test_failing_runs_are_avoided(identify: Identify) -> None:
    """A negative drag makes the position grow beyond all numbers."""
    result = identify({"Cart.m": "0.01:10", "Cart.b": "-500:5"}, starts=4, **data(noisy(c=0.0)))
    assert result["Cart.m"].value == pytest.approx(1.3, rel=0.02)
    assert any("failed, most often because: " in note for note in result.notes)
    with pytest.raises(RunError, match="runs of all starting points fail"):
        identify({"Cart.b": "-900:-600"}, **data(noisy()))


def test_columns_with_names_of_signals_are_compared(identify: Identify) -> None:
    x = noisy()
    columns = {"time": TIME, "Cart.x": x, "Cart.v": np.gradient(x, TIME), "remark": ["as usual"] * len(TIME)}
    driven = {"time": TIME, "Cart.F": FORCE, "remark": ["as usual"] * len(TIME)}
    for selection, signals in ((("Cart.x",), {"Cart.x"}), ((), {"Cart.x", "Cart.v"})):
        options = {"measured": [ec.Input(data=columns, columns=selection)], "input": [ec.Input(data=driven)]}
        values = {"Cart.b": TRUE["b"], "Cart.c": TRUE["c"]}
        result = identify({"Cart.m": "0.2:10"}, set=values, **options)
        assert {fit.signal for fit in result.fits} == signals
    assert any("columns that were not compared: remark" in note for note in result.data_notes)


def test_short_names_of_a_single_fmu_become_full_names(identify: Identify) -> None:
    measured = ec.Input(data={"time": TIME, "place": noisy()}, signals={"x": "place"})
    vary = {"Cart.m": "0.2:10", "offset(x)": "-0.1:0.1"}
    options = {"set": {"Cart.b": TRUE["b"], "Cart.c": TRUE["c"]}, "input": data(FORCE)["input"]}
    result = identify(vary, measured=[measured], sigma={"x": 1e-3}, **options)
    assert result.fits[0].signal == "Cart.x" and result.sigma == {"Cart.x": 1e-3}
    assert result["Cart.m"].value == pytest.approx(1.3, rel=0.01)


def test_negative_delay_of_a_sensor_is_estimated(identify: Identify) -> None:
    """The run continues after the last sample, which was taken later than its time says."""
    is_early = TIME <= 1.9
    x = np.interp(TIME[is_early] + 0.05, TIME, motion(**TRUE))
    measured = ec.Input(data={"time": TIME[is_early], "x": x}, signals={"Cart.x": "x"})
    driven = data(x, FORCE)["input"]
    vary = {"Cart.m": "0.2:10", "delay(Cart.x)": "-0.1:0.1"}
    options = {"set": {"Cart.b": TRUE["b"], "Cart.c": TRUE["c"]}}
    result = identify(vary, measured=[measured], input=driven, **options)
    assert result["delay(Cart.x)"].value == pytest.approx(-0.05, abs=1e-3)
    assert result["Cart.m"].value == pytest.approx(1.3, rel=2e-3) and result.fits[0].rms < 1e-4


@pytest.mark.parametrize("value", ["NaN", '"a lot"', "null", "1e999"])
def test_search_does_not_continue_from_a_corrupt_record(value: str, tmp_path: Path) -> None:
    from emla_cosim.analyses.identify.report import read_unfinished

    good = '{"status": "unfinished", "estimates": [{"name": "p", "value": 2.5}]}'
    (tmp_path / "identify.json").write_text(good)
    assert read_unfinished(tmp_path, ["p"]) == {"p": 2.5}
    (tmp_path / "identify.json").write_text(good.replace("2.5", value))
    assert read_unfinished(tmp_path, ["p"]) is None


def test_lost_start_values_are_reported(tmp_path: Path) -> None:
    careless = str(build_reluctant_fmu(tmp_path / "reluctant.fmu"))
    name = ec.load(careless).system.components[0].name
    run = ec.load(careless, stop_time=1.0, step_size=0.01).prepare().run()
    signal = run.names[0]
    values = run[signal] + 1e-3 * np.sin(50.0 * run.time)
    measured = ec.Input(data={"time": run.time, "y": values}, signals={signal: "y"})
    options = {"stop_time": 1.0, "step_size": 0.01, "set": {f"{name}.stubborn": True}}
    result = ec.identify(careless, {f"{name}.gain": "0.5:20"}, measured=[measured], **options)
    assert any("did not take" in note for note in result.notes), result.notes


def test_interrupted_search_can_be_continued(
    identify: Identify, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from emla_cosim.analyses.identify import prediction

    x, folder, predict = noisy(), tmp_path / "out", prediction.Predictor.predict

    def limited(self: prediction.Predictor, *arguments: Any, **how: Any) -> Any:
        if self.runs.count > 12:
            raise prediction.InterruptedRunsError
        return predict(self, *arguments, **how)

    monkeypatch.setattr(prediction.Predictor, "predict", limited)
    result = identify(RANGES, output=folder, **data(x))
    assert not result.complete and result["Cart.m"].problem == "interrupted"
    record = json.loads((folder / "identify.json").read_text())
    assert record["status"] == "unfinished" and record["estimates"][0]["value"] == result["Cart.m"].value
    monkeypatch.setattr(prediction.Predictor, "predict", predict)
    progress, notes = Progress(), list[str]()
    monkeypatch.setattr(progress, "note", notes.append)
    continued = identify(RANGES, output=folder, progress=progress, **data(x))
    assert any("continued from the unfinished result" in note for note in notes)
    assert continued.complete and continued["Cart.m"].value == pytest.approx(1.3, rel=0.02)
    assert json.loads((folder / "identify.json").read_text())["status"] == "completed"


@pytest.mark.slow
def test_command_writes_a_scenario_that_runs(
    emla: Emla, fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    x = noisy()
    frame = polars.DataFrame({"t [ms]": 1e3 * TIME, "F [N]": FORCE, "x [mm]": 1e3 * x})
    frame.write_csv("test.csv")
    Path("plan.toml").write_text(f"""
        scenario = "{fmu}"
        stop_time = 2.0
        step_size = {STEP}
        [vary]
        "Cart.m" = "0.2 kg:10 kg"
        "Cart.b" = "0:5"
        "Cart.c" = "0:5"
        [sigma]
        "Cart.x" = "1 mm"
        [[experiments]]
        name = "square"
        input = [{{ file = "test.csv", signals = {{ "Cart.F" = "F" }} }}]
        measured = "test.csv:Cart.x=x"
    """)
    result = emla("identify", "plan.toml", "--workers", "1", "--output", "found", "--report")
    assert result.exit_code == 0, result.output
    assert (
        "95 % interval" in result.output and "Wrote found/: identify.json, identified.toml" in result.output
    )
    names = {p.name for p in Path("found").iterdir() if not p.name.startswith(".")}
    assert names == {"identified.toml", "identify.json", "samples.csv", "history.csv", "fit.png",
                     "certainty.png", "identify.html"}  # fmt: skip
    record = json.loads(Path("found/identify.json").read_text())
    estimates = {entry["name"]: entry for entry in record["estimates"]}
    assert estimates["Cart.m"]["value"] == pytest.approx(1.3, rel=0.02)
    assert estimates["Cart.m"]["unit"] == "kg"
    samples = polars.read_csv("found/samples.csv")
    assert samples["measured"].to_numpy() == pytest.approx(x)
    assert np.std(samples["predicted"].to_numpy() - motion(**TRUE)) < 3e-4
    with ec.load("found/identified.toml").prepare() as simulation:
        assert simulation.run().parameters["Cart.m"] == estimates["Cart.m"]["value"]
    assert sentence(emla("identify", "plan.toml", "--workers", "1", "--vary", "Cart.q=1:2"), 2)
    arguments = ("--measured", "found/samples.csv:Cart.x=measured", "--output", "found")
    message = sentence(emla("identify", str(fmu), "--vary", "Cart.m=1:2", *arguments), 2)
    assert "samples.csv" in message and "measured data" in message
    Path("mine").mkdir()
    Path("mine/identify.json").write_text("{}")
    message = sentence(emla("identify", "plan.toml", "--workers", "1", "--output", "mine"), 2)
    assert "identify.json" in message and Path("mine/identify.json").read_text() == "{}"

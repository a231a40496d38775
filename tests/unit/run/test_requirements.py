"""`--require`: a run that does not meet a requirement ends with exit code 1 and the measured value."""

import json
import math
import signal
from collections.abc import Iterator
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.recorders.metrics import list_figures
from emla_cosim.run.requirements import Requirement, describe_unmet, parse_requirement
from tests.support.commands import Emla, sentence

RUN = ("run", "lift", "--stop-time", "0.4", "--no-plots", "--output", "o")
SIGNS = {
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
}


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.4) as simulation:
        yield simulation


def requiring(*texts: str) -> list[str]:
    return [part for text in texts for part in ("--require", text)]


def test_met_requirements_end_with_0(emla: Emla) -> None:
    requirements = ["lift.position_error_m < 2e-5", "lift.held==true", "run.steps >= 4000", "run.wall_s > 0"]
    result = emla(*RUN, *requiring(*requirements))
    assert result.exit_code == 0, result.output
    record = json.loads(Path("o/run.json").read_text())
    assert record["settings"]["require"] == requirements and record["status"] == "completed"


def test_unmet_requirements_are_listed_and_results_are_kept(emla: Emla) -> None:
    requirements = ("lift.position_error_m < 1e-9", "lift.torque_peak_N_m < 190", "lift.held == false")
    text = sentence(emla(*RUN, *requiring(*requirements)), 1)
    joint = json.loads(Path("o/metrics.json").read_text())["joints"]["lift"]
    assert text == (
        "Error: requirements not met: lift.position_error_m < 1e-09, but it is "
        f"{joint['position_error_m']:.6g}; lift.held == false, but it is true. "
        "The results so far are in o."
    )
    assert "torque_peak" not in text
    assert len(Path("o/results.csv").read_text().splitlines()) == 402
    assert json.loads(Path("o/run.json").read_text())["status"] in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lift.held", "Write METRIC"),
        ("< 3", "Write METRIC"),
        ("lift.position_error_m = 3", "Write METRIC"),
        ("0 < lift.position_error_m < 3", "Write METRIC"),
        ("lift.position_error_m < 20 µm", "Write METRIC"),
        ("lift.position_error_m < nan", "Write METRIC"),
        ("lift.held < true", "use == or != with true and false"),
        ("lift.held == 1", "lift.held is true or false"),
        ("lift.position_error_m != false", "lift.position_error_m is a number"),
        ("lift.position_eror_m < 1", "did you mean lift.position_error_m"),
        ("lift.trip == false", "there is no metric 'lift.trip'"),
        ("lift." + "x" * 200 + " < 1", "there are lift.held,"),
    ],
)
def test_invalid_requirement(text: str, words: str, lift: ec.Simulation) -> None:
    with pytest.raises(CommandError) as caught:
        lift.run(require=[text])
    assert words in str(caught.value)


def test_invalid_requirement_keeps_an_earlier_run(emla: Emla) -> None:
    assert emla(*RUN).exit_code == 0
    before = Path("o/results.csv").read_bytes()
    assert "Write METRIC" in sentence(emla(*RUN, *requiring("lift.held")), 2)
    assert "there is no metric 'tilt.held'" in sentence(emla(*RUN, *requiring("tilt.held == true")), 2)
    assert Path("o/results.csv").read_bytes() == before


def test_missing_value_and_failed_run(lift: ec.Simulation) -> None:
    """A run that fails reports the failure, not the requirements that it leaves open."""
    with pytest.raises(ec.RunError, match=r"lift\.position_error_m >= 0, but it is missing\."):
        lift.run(stop_time=0.1, require=["lift.position_error_m >= 0"])
    with pytest.raises(ec.RunError, match=r"^the run ended at t = "):
        lift.run(set={"lift.observer.alpha_2": 1e300}, require=["lift.held == true"])


def test_options_override_requirements_of_a_scenario_file(emla: Emla) -> None:
    text = 'system = "lift"\nstop_time = 0.4\nplots = false\nrequire = {}\n'
    Path("mine.toml").write_text(text.format('["lift.position_error_m < 1e-9"]'))
    assert "lift.position_error_m < 1e-09, but" in sentence(emla("run", "mine.toml"), 1)
    assert emla("run", "mine.toml", *requiring("lift.position_error_m < 1")).exit_code == 0
    Path("mine.toml").write_text(text.format('"lift.position_error_m < 1"'))
    assert "it must be a list" in sentence(emla("run", "mine.toml"), 2)


def test_requirements_in_python(lift: ec.Simulation) -> None:
    with pytest.raises(
        ec.RunError, match=r"^requirements not met: lift\.held == false, but it is true\.$"
    ) as e:
        lift.run(require=["lift.held == false"])
    result = e.value.fields["result"]
    assert result.metrics["joints"]["lift"]["held"] is True and len(result.time) == 401
    assert lift.attempt(require=["run.steps == 4000"]).problem is None
    lift.start(require=["lift.held == true"])
    lift.advance(0.1)
    with pytest.raises(ec.RunError, match=r"lift\.held == true, but it is false"):
        lift.finish()


def test_interrupted_run_does_not_meet_requirements(lift: ec.Simulation) -> None:
    class Interrupt(ec.Recorder):
        is_requested = False

        def write(self, rows: object) -> None:
            if not self.is_requested:  # a second one, if the machine takes its time, ends everything at once
                signal.raise_signal(signal.SIGINT)
            self.is_requested = True

    with pytest.raises(ec.RunError, match=r"before these requirements could be checked: run\.steps > 0\.$"):
        lift.run(require=["run.steps > 0"], recorders=[Interrupt()], stop_time=50.0)


@given(
    name=st.from_regex(r"[a-z][a-z_]{0,8}\.[a-z][a-z_]{0,8}", fullmatch=True),
    sign=st.sampled_from(list(SIGNS)),
    value=st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**6), 10**6),
    figure=st.floats() | st.none(),
    blank=st.sampled_from(["", " ", "  "]),
)
def test_requirements_compare_like_python(
    name: str, sign: str, value: float, figure: float | None, blank: str
) -> None:
    required = parse_requirement(f"{blank}{name}{blank}{sign}{blank}{value!r}{blank}")
    assert required == Requirement(name, sign, float(value))
    of, _, metric = name.partition(".")
    sentence_ = describe_unmet([required], list_figures({"kind": {of: {metric: figure}}}))
    met = figure is not None and not math.isnan(figure) and SIGNS[sign](figure, value)
    assert (sentence_ is None) == met
    if not met:
        assert str(sentence_).startswith(f"requirements not met: {name} {sign} ")


@given(st.text(max_size=40))
def test_any_text_is_a_requirement_or_an_error(text: str) -> None:
    try:
        actual = parse_requirement(text)
    except CommandError as error:
        assert text in str(error)
    else:
        assert actual.figure in text and actual.sign in text

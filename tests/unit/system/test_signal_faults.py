"""Signals that fail at a time: what receivers get, and that nothing else changes."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.analyses.variants.factors import format_arguments
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.interface import read_interface
from emla_cosim.fmu.models import FLAVOURS, build
from emla_cosim.master.network import Link, find_stepping_order, order_with_followers
from emla_cosim.study.loading import load
from emla_cosim.system.fault import Fault, read_faults
from emla_cosim.system.resolution import find_transformation
from emla_cosim.system.signal_faults import add_fault_components, wire_faults
from emla_fmu import SignalFault
from fmublock.instance import Instance
from tests.support.commands import Emla, sentence
from tests.support.faulty_systems import faulty, wired
from tests.support.ssp_documents import fake_fmu
from tests.support.tiers import mostly_slow

ENCODER = "lift.plant.x_measured"
FAULT = "lift.plant_x_measured_fault"


def signals(fmus: Path, *faults: Any, stop_time: float = 0.02, **options: Any) -> dict[str, np.ndarray]:
    """All signals of the lift at every step."""
    with load("lift", fault=list(faults), stop_time=stop_time, fmus=fmus, **options).prepare() as simulation:
        result = simulation.run(output_interval=1e-4)
        return {name: np.array(result[name]) for name in ["time", *simulation.names]}


def differing(signals_1: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> set[str]:
    """Names of the expected signals that have other bits."""
    return {n for n in expected if signals_1[n].tobytes() != expected[n].tobytes()}


@pytest.fixture(scope="module")
def sound(fmu_folder: Path) -> dict[str, np.ndarray]:
    """Signals without a fault."""
    return signals(fmu_folder)


# ---- the block ------------------------------------------------------------------------------------

U = [3.0, -0.0, 5.0, 7.0, 11.0, 13.0, 17.0]
"""Signal at 0, 0.1, ... s; the fault lasts from 0.3 to 0.5 s."""


def block(**values: float) -> Any:
    """An initialized block; the function returned sets the input, steps to a time and returns outputs."""
    instance = Instance(SignalFault())
    r = instance.layout.reference
    instance.set([r(n) for n in values], list(values.values()))
    instance.setup_experiment(0.0)
    instance.enter_initialization()
    instance.exit_initialization()

    def step(u: float | None = None, time: float = 0.0) -> list[float]:
        if u is not None:
            instance.set([r("u")], [u])
            instance.do_step(instance.time, time - instance.time)
        return instance.get([r("y"), r("active")])

    return step


@pytest.mark.parametrize(
    ("effect", "during"),
    [
        ({}, [7.0, 11.0]),
        ({"freeze": 1.0, "gain": 2.0, "offset": 2.0}, [5.0, 5.0]),
        ({"gain": 0.0, "offset": 2.0}, [2.0, 2.0]),
        ({"gain": 2.0, "offset": 2.0}, [16.0, 24.0]),
    ],
)
def test_effects_on_a_signal(effect: Mapping[str, float], during: Sequence[float]) -> None:
    step = block(**effect, start=0.3, duration=0.2, u=U[0])
    outputs = [step(), *(step(u, (k + 1) / 10) for k, u in enumerate(U[1:]))]
    y, active = np.array(outputs).T
    assert y.tobytes() == np.array([*U[:3], *during, *U[5:]]).tobytes()  # minus zero included
    assert active.tolist() == [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def test_freeze_from_the_start_keeps_the_first_step() -> None:
    step = block(freeze=1.0, start=0.0, u=1.0)
    outputs = [step(), *(step(u, 0.1 * (k + 1)) for k, u in enumerate((2.0, 3.0, 4.0)))]
    assert [y for y, _ in outputs] == [1.0, 2.0, 2.0, 2.0]


@pytest.mark.parametrize("signal", [math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("offset", [2.0, 0.0])
def test_constant_hides_a_signal_that_is_not_finite(signal: float, offset: float) -> None:
    assert block(gain=0.0, offset=offset, start=0.0, u=signal)()[0] == offset


# ---- in a system ----------------------------------------------------------------------------------

ORDER = ("reference", "plant", "disturbance", "observer", "controller")


@pytest.mark.parametrize(
    ("names", "options"),
    [
        ((ENCODER,), {}),
        (("lift.observer.y", "lift.controller.i_q_ref"), {}),
        (("lift.reference.x_d", "lift.controller.x_hat", "lift.plant.F_L"), {}),
        ((ENCODER, ENCODER, "lift.observer.y", "lift.controller.u_q", "lift.plant.d_2"), {}),
        # an order need not name faults; each is stepped behind its source
        ((ENCODER,), {"order": [f"lift.{name}" for name in ORDER]}),
    ],
)
def test_fault_that_does_not_begin_changes_no_bit(
    names: Sequence[str], options: dict[str, Any], fmu_folder: Path, sound: dict[str, np.ndarray]
) -> None:
    """Of no signal, in gauss-seidel: the order of the others is what it was."""
    with_fault = signals(fmu_folder, *(Fault(name, "freeze", 1.0) for name in names), **options)
    assert differing(with_fault, sound) == set()
    assert len(with_fault) == len(sound) + 2 * len(names)


@pytest.mark.parametrize("flavour", mostly_slow(FLAVOURS, ["native"]))
def test_encoder_that_freezes_keeps_its_last_value_for_all_receivers(
    flavour: str, request: pytest.FixtureRequest
) -> None:
    folder = request.getfixturevalue("fmu_folder" if flavour == "native" else "python_fmu_folder")
    healthy = signals(folder, flavour=flavour)
    with_fault = signals(folder, Fault(ENCODER, "freeze", 0.01, 0.002), flavour=flavour)
    encoder_input, measured = with_fault[f"{FAULT}.y"], with_fault[ENCODER]
    assert (encoder_input[100:120] == measured[99]).all() and len(set(measured[99:120])) > 10
    assert (encoder_input[:100] == measured[:100]).all() and (encoder_input[120:] == measured[120:]).all()
    # the observer reacts in the same step, and no signal before
    differ = with_fault["lift.observer.x_hat"] != healthy["lift.observer.x_hat"]
    assert np.flatnonzero(differ)[0] == 100


def test_fault_of_an_input_leaves_its_source_alone(fmu_folder: Path, sound: dict[str, np.ndarray]) -> None:
    with_fault = signals(fmu_folder, Fault("lift.observer.i_q_ref", "constant", 0.01, value=7.0))
    assert (with_fault["lift.observer_i_q_ref_fault.y"][100:] == 7.0).all()
    # robust: the observer does not use it
    assert with_fault["lift.plant.x_L"].tobytes() == sound["lift.plant.x_L"].tobytes()


def test_unconnected_input_fails_from_its_start_value(faulty_fmu: Path) -> None:
    """y' = u with u = 0.5, and 3 more from 0.5 s on."""
    system = wired([faulty("j.a", faulty_fmu, u=0.5)])
    fault = Fault("j.a.u", "offset", 0.5, value=3.0)
    options: dict[str, Any] = {"fault": [fault], "stop_time": 1.0, "step_size": 0.1}
    with ec.load(system, **options).prepare() as simulation:
        result = simulation.run(output_interval=0.1)
    assert result["j.a_u_fault.y"].tolist() == [0.5] * 5 + [3.5] * 6
    with pytest.raises(CommandError, match=r"j\.a\.u cannot be set: it is driven by j\.a_u_fault\.y"):
        ec.load(system, **options, set={"j.a.u": 0.7}).prepare()
    # the fault has no source and is first: from 0.4 to 0.5 s the input has what it is at 0.5 s
    assert np.diff(result["j.a.y"]) == pytest.approx([0.05] * 4 + [0.35] * 6)


@pytest.mark.parametrize(("algorithm", "late"), [("jacobi", 1), ("gauss-seidel", 0), ("strong", 0)])
def test_faults_in_sequence_on_one_signal(algorithm: str, late: int, fmu_folder: Path) -> None:
    """The second one gets the output of the first one; with jacobi each is late by a step."""
    faults = [Fault(ENCODER, "offset", 0.005, 0.008, 1e-6), Fault(ENCODER, "gain", 0.012, None, 2.0)]
    with_fault = signals(fmu_folder, *faults, algorithm=algorithm)
    first, second = with_fault[f"{FAULT}.y"], with_fault[f"{FAULT}_2.y"]
    k = np.arange(late, len(first))
    assert first[k] == pytest.approx(
        with_fault[ENCODER][k - late] + 1e-6 * ((k >= 50) & (k < 130)), abs=1e-15
    )
    assert second[k] == pytest.approx(first[k - late] * np.where(k >= 120, 2.0, 1.0), abs=1e-15)
    assert with_fault["lift.observer.y_bar"][120 + late] > 0.05  # of the 0.24 m by which the position jumps


@pytest.mark.parametrize(("signal", "factors"), [("a.x", [1.0, 1e-3]), ("b.u", [1e-3, 1.0])])
def test_value_is_in_the_unit_of_its_signal(signal: str, factors: Sequence[float], tmp_path: Path) -> None:
    """The source is in mm, its receiver in m: a fault has the unit of its signal."""
    system = ec.System.of({"a": "Reference", "b": "EmlaObserver"}, ["a.x -> b.u"])
    with_components, fault_components = add_fault_components(
        system, [Fault(signal, "offset", 0.5, value=1.0)]
    )
    (fault,) = fault_components
    variables = {"a": ["x:output:mm"], "b": ["u:input:m"], fault: ["u:input", "y:output"]}
    interfaces = {n: read_interface(fake_fmu(tmp_path / f"{n}.fmu", *v)) for n, v in variables.items()}
    connected = wire_faults(with_components, fault_components, interfaces)
    after = {x.source: find_transformation(x, interfaces).factor for x in connected.connections}
    assert [after["a"], after[fault]] == pytest.approx(factors)


# ---- in files, commands and packages ----------------------------------------------------------------

FILE = """
system = "lift"
stop_time = 0.02
[[fault]]
signal = "lift.plant.x_measured"
kind = "offset"
value = 2e-5
start = 0.005
duration = 0.01
"""
LINE = f"{ENCODER}=offset:2e-5@0.005+0.01"
ENTRIES = {"signal": ENCODER, "kind": "offset", "value": 2e-5, "start": 0.005, "duration": 0.01}


def rows(folder: str) -> bytes:
    return Path(folder, "results.csv").read_bytes()


def ran(emla: Emla, *arguments: str, folder: str) -> bytes:
    """The results of a run by the command."""
    result = emla("run", *arguments, "--no-plots", "--output", folder)
    assert result.exit_code == 0, result.output
    return rows(folder)


def test_file_command_python_and_package_give_the_same(emla: Emla, fmu_folder: Path) -> None:
    Path("my.toml").write_text(FILE)
    lift = ("lift", "--stop-time", "0.02")
    rows_of_file = ran(emla, "my.toml", folder="file")
    assert rows_of_file == ran(emla, *lift, "--fault", LINE, folder="line") != ran(emla, *lift, folder="none")
    by_text, by_table = signals(fmu_folder, LINE), signals(fmu_folder, ENTRIES)
    assert differing(by_text, by_table) == set()
    record = json.loads(Path("file/run.json").read_text())
    assert record["settings"]["fault"] == [ENTRIES]
    assert record["components"][f"{FAULT}"]["parameters"]["start"] == 0.005
    assert json.loads(Path("file/metrics.json").read_text())["joints"].keys() == {"lift"}
    later = ran(emla, "my.toml", "--set", f"{FAULT}.start=0.01", folder="later")
    assert (
        later
        == ran(emla, *lift, "--fault", LINE.replace("0.005", "0.01"), folder="line later")
        != rows_of_file
    )
    assert emla("export", "my.toml", "my.ssp").exit_code == 0
    assert ran(emla, "my.ssp", folder="package") == rows_of_file


def test_checkpoint_within_a_freeze_is_continued(emla: Emla) -> None:
    fault = ["lift", "--fault", f"{ENCODER}=freeze@0.004+0.001", "--output-interval", "1ms"]
    expected = ran(emla, *fault, "--stop-time", "0.01", folder="whole")
    ran(emla, *fault, "--stop-time", "0.0045", "--checkpoint", "c", folder="parts")
    assert ran(emla, *fault, "--stop-time", "0.01", "--resume", "c", folder="parts") == expected


def test_faults_are_arguments_of_the_command() -> None:
    faults = [Fault(ENCODER, "freeze", 1.0, 0.1), Fault("lift.observer.y", "gain", -1e-3, None, -2.5)]
    flag, text = format_arguments({"fault": faults}) or []
    assert flag == "--fault" and read_faults(text) == faults


# ---- messages ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (f"{ENCODER}s=freeze@1", "lift.plant has no variable 'x_measureds'; did you mean x_measured"),
        ("lift.plnt.x=freeze@1", "there is no component 'lift.plnt'"),
        (f"{ENCODER}=freeze", "cannot be read; write SIGNAL=KIND:VALUE@START+DURATION"),
        (f"{ENCODER}=stick@1", "no kind of fault 'stick'; choose from freeze, offset, gain and constant"),
        (f"{ENCODER}=offset@1", "is of the kind offset, which needs a value"),
        (f"{ENCODER}=freeze:1@1", "is of the kind freeze, which keeps the last value of the signal"),
        (f"{ENCODER}=freeze@1+-0.1", "lasts -0.1 s; that must be a positive number"),
        (f"{ENCODER}=freeze@1e999", "begins at inf s; that must be a finite number"),
        ("lift.plant.motor.R_s=freeze@1", "is a parameter; a fault needs an output or an input"),
        ("lift.plant.P_L=freeze@1", "lift.plant.P_L is not connected"),
    ],
)
def test_invalid_faults(fault: str, words: str, fmu_folder: Path) -> None:
    with pytest.raises(CommandError) as caught:
        load("lift", fault=[fault], stop_time=0.001, fmus=fmu_folder).prepare()
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('signal = "lift.plant.x_measured"', "cannot be used for 2 reasons"),
        ('signal = "lift.plant.x_measured"\nkind = "freeze"\nstart = "soon"', "'start'"),
        ('signal = "lift.plant.x_measured"\nkind = "freeze"\nstart = 1\nend = 2', "unknown entry 'end'"),
    ],
)
def test_invalid_tables_of_a_scenario_file(table: str, words: str, emla: Emla) -> None:
    Path("my.toml").write_text(f'system = "lift"\n[[fault]]\n{table}\n')
    message = sentence(emla("run", "my.toml"), 2)
    assert words in message and "'my.toml'" in message


def test_signals_that_are_not_continuous_are_refused(fmu_folder: Path) -> None:
    interface = read_interface(build("EmlaPlant", "native", [], fmu_folder))
    interface.variables["x_measured"].variability = "discrete"
    system, placed = add_fault_components(load("lift").system, [Fault(ENCODER, "freeze", 1.0)])
    with pytest.raises(CommandError, match=r"x_measured is a discrete Real; a fault needs a continuous Real"):
        wire_faults(system, placed, {"lift.plant": interface})


# ---- the order of stepping --------------------------------------------------------------------------


@given(data=st.data())
def test_followers_do_not_change_the_order_of_the_others(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 6))
    ends = st.integers(0, count - 1)
    drawn = data.draw(st.lists(st.tuples(ends, ends, st.booleans()), max_size=12))
    links = [Link(a, 0, b, k, direct) for k, (a, b, direct) in enumerate(drawn)]
    followed, followers = list(links), set[int]()
    for k in data.draw(st.lists(st.integers(0, len(links) - 1), max_size=6)) if links else []:
        follower, link = count + len(followers), followed[k]
        followers.add(follower)
        followed[k] = replace(link, source=follower, output=0)
        followed.append(Link(link.source, link.output, follower, 0, True))
    order = order_with_followers(count + len(followers), followed, followers)
    assert sorted(order) == list(range(count + len(followers)))
    assert [i for i in order if i not in followers] == find_stepping_order(count, links)
    for link in followed:
        if link.target in followers:
            assert order.index(link.source) < order.index(link.target)

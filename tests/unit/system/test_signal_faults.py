"""Signals that fail by schedule: what receivers get, and that nothing else changes."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from typer.testing import CliRunner, Result

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.base.units import SiUnit
from emla_cosim.cli.app import app
from emla_cosim.fmu.interface import read_interface
from emla_cosim.fmu.models import FLAVOURS, build
from emla_cosim.master.network import Link, order_with_followers, stepping_order
from emla_cosim.study.loading import load
from emla_cosim.sweeps.targets import format_arguments
from emla_cosim.system.fault import Fault, read_faults
from emla_cosim.system.resolution import find_transformation
from emla_cosim.system.signal_faults import add_fault_components, wire_faults
from emla_fmu import SignalFault
from fmublock.instance import Instance
from tests.support.faulty_systems import faulty, wired

ENCODER = "lift.plant.x_measured"
FAULT = "lift.plant_x_measured_fault"
Emla = Callable[..., Result]


@pytest.fixture
def emla(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Emla:
    monkeypatch.chdir(tmp_path)

    def called(command: str, *arguments: str) -> Result:
        quiet = ["--no-plots"] if command == "run" else []
        return CliRunner().invoke(app, [command, *arguments, *quiet, "--fmus", str(fmu_folder)])

    return called


def ran(result: Result) -> None:
    assert result.exit_code == 0, result.output


def signals(fmus: Path, *faults: Any, stop_time: float = 0.02, **options: Any) -> dict[str, np.ndarray]:
    """All signals of the lift at every step."""
    with load("lift", fault=list(faults), stop_time=stop_time, fmus=fmus, **options).prepare() as simulation:
        result = simulation.run(output_interval=1e-4)
        return {name: np.array(result[name]) for name in ["time", *simulation.names]}


# ---- the block ------------------------------------------------------------------------------------

U = [3.0, -0.0, 5.0, 7.0, 11.0, 13.0, 17.0]
"""Signal at 0, 0.1, ... s; the fault lasts from 0.3 to 0.5 s."""


@pytest.mark.parametrize(
    ("effect", "during"),
    [
        ({}, [7.0, 11.0]),
        ({"freeze": 1.0}, [5.0, 5.0]),
        ({"freeze": 1.0, "gain": 2.0, "offset": 2.0}, [5.0, 5.0]),
        ({"offset": 2.0}, [9.0, 13.0]),
        ({"gain": 2.0}, [14.0, 22.0]),
        ({"gain": 0.0, "offset": 2.0}, [2.0, 2.0]),
        ({"gain": 2.0, "offset": 2.0}, [16.0, 24.0]),
    ],
)
def test_what_becomes_of_a_signal(effect: Mapping[str, float], during: Sequence[float]) -> None:
    block = Instance(SignalFault())
    r = block.layout.reference
    values = {**effect, "start": 0.3, "duration": 0.2, "u": U[0]}
    block.set([r(n) for n in values], list(values.values()))
    block.setup_experiment(0.0)
    block.enter_initialization()
    block.exit_initialization()
    found = [block.get([r("y"), r("active")])]
    for k, u in enumerate(U[1:]):
        block.set([r("u")], [u])
        block.do_step(k / 10, (k + 1) / 10 - k / 10)
        found.append(block.get([r("y"), r("active")]))
    y, active = np.array(found).T
    assert y.tobytes() == np.array([*U[:3], *during, *U[5:]]).tobytes()  # minus zero included
    assert active.tolist() == [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize("signal", [math.inf, -math.inf, math.nan])
@pytest.mark.parametrize(("effect", "during"), [({"offset": 2.0}, 2.0), ({"offset": 0.0}, 0.0)])
def test_a_constant_hides_a_signal_that_is_not_finite(
    signal: float, effect: Mapping[str, float], during: float
) -> None:
    block = Instance(SignalFault())
    r = block.layout.reference
    values = {"gain": 0.0, **effect, "start": 0.0, "u": signal}
    block.set([r(n) for n in values], list(values.values()))
    block.setup_experiment(0.0)
    block.enter_initialization()
    block.exit_initialization()
    assert block.get([r("y")])[0] == during


def test_a_freeze_from_the_start_keeps_the_first_step() -> None:
    block = Instance(SignalFault())
    r = block.layout.reference
    block.set([r("freeze"), r("start"), r("u")], [1.0, 0.0, 1.0])
    block.setup_experiment(0.0)
    block.enter_initialization()
    block.exit_initialization()
    found = [block.get([r("y")])[0]]
    for k, u in enumerate((2.0, 3.0, 4.0)):
        block.set([r("u")], [u])
        block.do_step(0.1 * k, 0.1)
        found.append(block.get([r("y")])[0])
    assert found == [1.0, 2.0, 2.0, 2.0]


# ---- in a system ----------------------------------------------------------------------------------

ANY_SIGNAL = [
    (ENCODER,),
    ("lift.observer.y",),
    ("lift.controller.u_q",),
    ("lift.controller.i_q_ref",),
    ("lift.plant.d_2",),
    ("lift.reference.x_d", "lift.controller.x_hat", "lift.plant.F_L"),
    (ENCODER, ENCODER, "lift.observer.y"),
]


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("names", ANY_SIGNAL, ids=", ".join)
def test_a_fault_that_does_not_begin_changes_no_bit(
    names: Sequence[str], compiled: bool, fmu_folder: Path
) -> None:
    """Of no signal, in gauss-seidel: the order of the others is what it was."""
    faults = [Fault(name, "freeze", 1.0) for name in names]
    expected = signals(fmu_folder, compiled=compiled)
    found = signals(fmu_folder, *faults, compiled=compiled)
    assert {n for n in expected if found[n].tobytes() != expected[n].tobytes()} == set()
    assert len(found) == len(expected) + 2 * len(faults)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_encoder_that_freezes_keeps_its_last_value_for_all_receivers(
    flavour: str, fmu_folder: Path, python_fmu_folder: Path
) -> None:
    folder = fmu_folder if flavour == "native" else python_fmu_folder
    whole = signals(folder, flavour=flavour)
    found = signals(folder, Fault(ENCODER, "freeze", 0.01, 0.002), flavour=flavour)
    given, measured = found[f"{FAULT}.y"], found[ENCODER]
    assert (given[100:120] == measured[99]).all() and len(set(measured[99:120])) > 10
    assert (given[:100] == measured[:100]).all() and (given[120:] == measured[120:]).all()
    # the observer feels it in the same step, and nobody before
    differ = found["lift.observer.x_hat"] != whole["lift.observer.x_hat"]
    assert np.flatnonzero(differ)[0] == 100


def test_an_input_fails_for_itself_alone(fmu_folder: Path) -> None:
    found = signals(fmu_folder, Fault("lift.observer.i_q_ref", "constant", 0.01, value=7.0))
    assert (found["lift.observer_i_q_ref_fault.y"][100:] == 7.0).all()
    expected = signals(fmu_folder)  # robust: the observer does not use it
    assert found["lift.plant.x_L"].tobytes() == expected["lift.plant.x_L"].tobytes()


def test_an_input_that_nothing_drives_fails_from_its_start_value(faulty_fmu: Path) -> None:
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
    """The second one has what the first one gives; with jacobi each is late by a step."""
    faults = [Fault(ENCODER, "offset", 0.005, 0.008, 1e-6), Fault(ENCODER, "gain", 0.012, None, 2.0)]
    found = signals(fmu_folder, *faults, algorithm=algorithm)
    first, second = found[f"{FAULT}.y"], found[f"{FAULT}_2.y"]
    k = np.arange(late, len(first))
    assert first[k] == pytest.approx(found[ENCODER][k - late] + 1e-6 * ((k >= 50) & (k < 130)), abs=1e-15)
    assert second[k] == pytest.approx(first[k - late] * np.where(k >= 120, 2.0, 1.0), abs=1e-15)
    assert found["lift.observer.y_bar"][120 + late] > 0.05  # of the 0.24 m by which the position jumps


@dataclass(frozen=True)
class MetricDisplay:
    """What an FMU with one Real shows of it."""

    variables: Mapping[str, Any]
    own: SiUnit | None

    def unit(self, name: str) -> SiUnit | None:
        return self.own


@pytest.mark.parametrize(("signal", "factors"), [("a.x", [1.0, 1e-3]), ("b.u", [1e-3, 1.0])])
def test_a_value_is_in_the_unit_of_its_signal(signal: str, factors: Sequence[float]) -> None:
    """The source is in mm, its receiver in m: a fault has the unit of its signal."""
    system = ec.System.of({"a": "Reference", "b": "EmlaObserver"}, ["a.x -> b.u"])
    made, placed = add_fault_components(system, [Fault(signal, "offset", 0.5, value=1.0)])
    metre = SiUnit("m", (0, 1, 0, 0, 0, 0, 0, 0))
    variables = {"x": "output", "u": "input", "y": "output"}
    shown = {
        n: SimpleNamespace(name=n, causality=c, type="Real", variability="continuous", start=None)
        for n, c in variables.items()
    }
    units = {"a": replace(metre, name="mm", factor=1e-3), "b": metre, next(iter(placed)): None}
    interfaces: Any = {name: MetricDisplay(shown, unit) for name, unit in units.items()}
    found = wire_faults(made, placed, interfaces)
    after = {x.source: find_transformation(x, interfaces).factor for x in found.connections}
    assert [after["a"], after[next(iter(placed))]] == factors


# ---- everywhere -----------------------------------------------------------------------------------

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


def test_file_command_and_python_say_the_same(emla: Emla, fmu_folder: Path, tmp_path: Path) -> None:
    Path("my.toml").write_text(FILE)
    ran(emla("run", "my.toml", "--output", "file"))
    ran(
        emla(
            "run",
            "lift",
            "--stop-time",
            "0.02",
            "--output",
            "line",
            "--fault",
            f"{ENCODER}=offset:2e-5@0.005+0.01",
        )
    )
    ran(emla("run", "lift", "--stop-time", "0.02", "--output", "none"))
    rows = {name: (tmp_path / name / "results.csv").read_bytes() for name in ("file", "line", "none")}
    assert rows["file"] == rows["line"] != rows["none"]
    text = signals(fmu_folder, f"{ENCODER}=offset:2e-5@0.005+0.01")
    table = {"signal": ENCODER, "kind": "offset", "value": 2e-5, "start": 0.005, "duration": 0.01}
    assert text[f"{FAULT}.y"].tobytes() == signals(fmu_folder, table)[f"{FAULT}.y"].tobytes()
    record = json.loads((tmp_path / "file/run.json").read_text())
    assert record["settings"]["fault"] == [table]
    assert record["components"][f"{FAULT}"]["parameters"]["start"] == 0.005
    assert json.loads((tmp_path / "file/metrics.json").read_text())["joints"].keys() == {"lift"}


def test_the_parameters_of_a_fault_can_be_set(emla: Emla, tmp_path: Path) -> None:
    Path("my.toml").write_text(FILE)
    ran(emla("run", "my.toml", "--output", "later", "--set", f"{FAULT}.start=0.01"))
    ran(
        emla(
            "run",
            "lift",
            "--stop-time",
            "0.02",
            "--output",
            "line",
            "--fault",
            f"{ENCODER}=offset:2e-5@0.01+0.01",
        )
    )
    assert (tmp_path / "later/results.csv").read_bytes() == (tmp_path / "line/results.csv").read_bytes()


def test_a_package_has_its_faults_with_it(emla: Emla, tmp_path: Path) -> None:
    Path("my.toml").write_text(FILE)
    ran(emla("run", "my.toml", "--output", "file"))
    ran(emla("export", "my.toml", "my.ssp"))
    ran(emla("run", "my.ssp", "--output", "package"))
    assert (tmp_path / "file/results.csv").read_bytes() == (tmp_path / "package/results.csv").read_bytes()


def test_a_checkpoint_within_a_freeze_goes_on(emla: Emla, tmp_path: Path) -> None:
    fault = ["--fault", f"{ENCODER}=freeze@0.004+0.001"]
    ran(emla("run", "lift", "--stop-time", "0.01", *fault, "--output", "whole"))
    ran(emla("run", "lift", "--stop-time", "0.0045", *fault, "--output", "parts", "--checkpoint", "c"))
    ran(emla("run", "lift", "--stop-time", "0.01", *fault, "--output", "parts", "--resume", "c"))
    assert (tmp_path / "whole/results.csv").read_bytes() == (tmp_path / "parts/results.csv").read_bytes()


def test_a_sweep_varies_a_fault(emla: Emla, tmp_path: Path) -> None:
    Path("my.toml").write_text(FILE)
    varied = ["--vary", f"{FAULT}.offset=0:1e-4:3", "--output", "sweep"]
    ran(emla("sweep", "my.toml", *varied))
    table = ec.read_sweep(tmp_path / "sweep").variants
    assert table[f"{FAULT}.offset"].to_list() == pytest.approx([0.0, 5e-5, 1e-4])
    assert table["lift.torque_peak_N_m"].n_unique() == 3


def test_a_variant_can_be_run_by_hand() -> None:
    faults = [Fault(ENCODER, "freeze", 1.0, 0.1), Fault("lift.observer.y", "gain", -1e-3, None, -2.5)]
    flag, text = format_arguments({"fault": faults}) or []
    assert flag == "--fault" and read_faults(text) == faults


# ---- what is wrong is said ------------------------------------------------------------------------


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
def test_a_wrong_fault_is_one_sentence(fault: str, words: str, emla: Emla) -> None:
    result = emla("run", "lift", "--fault", fault, "--stop-time", "0.001")
    assert result.exit_code == 2
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert words in line


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('signal = "lift.plant.x_measured"', "signal ="),
        ('signal = "lift.plant.x_measured"\nkind = "freeze"\nstart = "soon"', "'start'"),
        ('signal = "lift.plant.x_measured"\nkind = "freeze"\nstart = 1\nend = 2', "signal ="),
    ],
)
def test_a_wrong_table_is_one_sentence(table: str, words: str, emla: Emla) -> None:
    Path("my.toml").write_text(f'system = "lift"\n[[fault]]\n{table}\n')
    result = emla("run", "my.toml")
    assert result.exit_code == 2
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert words in line and "'my.toml'" in line


def test_signals_that_are_not_continuous_are_refused(fmu_folder: Path) -> None:
    system = load("lift").system
    interface = read_interface(build("EmlaPlant", "native", [], fmu_folder))
    interface.variables["x_measured"].variability = "discrete"
    wired_, placed = add_fault_components(system, [Fault(ENCODER, "freeze", 1.0)])
    with pytest.raises(CommandError, match=r"x_measured is a discrete Real; a fault needs a continuous Real"):
        wire_faults(wired_, placed, {"lift.plant": interface})


def test_an_order_need_not_name_faults(fmu_folder: Path) -> None:
    """As that of the experiments; each is stepped behind its source."""
    order = ["reference", "plant", "disturbance", "observer", "controller"]
    given = {"order": [f"lift.{name}" for name in order]}
    expected, found = (
        signals(fmu_folder, **given),
        signals(fmu_folder, Fault(ENCODER, "freeze", 1.0), **given),
    )
    assert {n for n in expected if found[n].tobytes() != expected[n].tobytes()} == set()


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
    assert [i for i in order if i not in followers] == stepping_order(count, links)
    for link in followed:
        if link.target in followers:
            assert order.index(link.source) < order.index(link.target)

"""FMUs of FMI 3.0 in all kinds of runs: what FMI 2.0 does not have.

That they have the bits of those of FMI 2.0 is shown in test_matrix.py.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
import fmublock
from emla_cosim.base import crash_page
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.fmu.file import open_fmu
from emla_cosim.fmu.log import FmuLog
from emla_cosim.master.instances.instance_kinds import make_instance
from emla_cosim.master.instances.measured_calls import code_of, decode_call
from tests.backends.systems import Springs
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_integrated_fmu

CLOCK = """<Clock name="tick" valueReference="30" causality="input" intervalVariability="constant"
                  intervalDecimal="1"/>"""
STEP, STOP = 0.05, 1.0
Fmus = Mapping[int, Path]


@pytest.fixture(scope="module")
def third(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_all_types_3_fmu(tmp_path_factory.mktemp("fmi3") / "Third.fmu")


@pytest.fixture(scope="module")
def integrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Model Exchange FMU: x' = u - x, y = x + gain u, a bouncing ball and a stair."""
    return build_integrated_fmu(tmp_path_factory.mktemp("me") / "Integrated.fmu", version=3)


@pytest.fixture(scope="module")
def springs(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    folder = tmp_path_factory.mktemp("springs")
    return {n: fmublock.build(Springs, folder / str(n) / "Springs.fmu", fmi=n) for n in (2, 3)}


def run(source: Any, **options: Any) -> ec.Result:
    run_options = {"step_size": STEP, "output_interval": STEP, "stop_time": STOP, **options}
    with ec.load(source, **run_options).prepare() as simulation:
        return simulation.run()


# ---- co-simulation -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inputs", "names"),
    [
        ([f"u[{element}]" for element in ("1,1", "1,2", "2,1", "2,2")], ("setFloat64", "getFloat64")),
        (["u[1,2]"], ("setting inputs", "getting outputs")),
    ],
)
def test_crash_is_reported_with_the_call_of_fmi_3(
    inputs: list[str], names: tuple[str, str], third: Path, tmp_path: Path
) -> None:
    instance = make_instance("a", open_fmu(third, tmp_path / "a"), inputs, ["x"], FmuLog())
    try:
        points = instance.entry_points()
        assert points is not None
        assert points.names == (*names, "getFMUState", "setFMUState")
        for name in points.names:
            assert decode_call(crash_page.Activity(code=code_of(3, name))) == (3, name)
    finally:
        instance.close()


# ---- Model Exchange ------------------------------------------------------------------------------


def rotating(fmu: Path) -> ec.System:
    """a' = -a - b, b' = a - b."""
    system = ec.System.of({"a": fmu, "b": fmu}, ["a.x -> b.u", "b.x -> a.u"], {"b.x": 0.0})
    first, second = system.connections
    second = dataclasses.replace(second, transformation=ec.LinearTransformation(-1.0))
    return dataclasses.replace(system, connections=(first, second))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"end": -1.0}, r"answered updateDiscreteStates at t = 0 s with nextEventTime = NaN"),
        ({"fails": 0.5}, "cannot be integrated at t = "),
    ],
)
def test_failures_name_the_functions_of_fmi_3(
    values: Mapping[str, float], message: str, integrated: Path
) -> None:
    with pytest.raises(RunError, match=message):
        run(integrated, set={f"Integrated.{name}": value for name, value in values.items()})


def test_fmu_may_end_the_run(integrated: Path) -> None:
    ended = run(integrated, set={"Integrated.end": 3.0})
    assert "asked to end the simulation during updateDiscreteStates at t = 0.3" in ended.remarks[0]


def test_another_number_of_event_indicators_is_reported(tmp_path: Path) -> None:
    path = build_integrated_fmu(tmp_path / "Integrated.fmu", version=3, indicators=2)
    with pytest.raises(RunError, match="getNumberOfEventIndicators with 2, and its model description has 1"):
        run(path)


def test_clocks_are_refused(tmp_path: Path) -> None:
    path = build_integrated_fmu(tmp_path / "Integrated.fmu", version=3, clock=CLOCK)
    message = r"has the clock 'tick', and clocks are supported for co-simulation only\.$"
    with pytest.raises(CommandError, match=message):
        run(path)
    (note,) = ec.info(path).notes
    assert note.startswith("the FMU cannot be run here: it has the clock 'tick'")


def test_error_control_needs_states(tmp_path: Path) -> None:
    path = build_integrated_fmu(tmp_path / "Integrated.fmu", version=3, rollback=False)
    with pytest.raises(CommandError, match="canGetAndSetFMUstate"):
        run(rotating(path), integrate_together=False, error_tolerance=1e-3)


# ---- arrays in Model Exchange: the bits of FMI 2.0, which has their elements as scalars ------------

ELEMENTS = ["a.y[1] -> b.F[2]", "b.y[2] -> a.F[1]"]
WHOLE_ARRAYS = [f"{source}.x[{i}] -> {target}.F[{i}]" for source, target in ("ab", "ba") for i in (1, 2)]


@pytest.mark.parametrize("connections", [ELEMENTS, WHOLE_ARRAYS], ids=["elements", "whole"])
def test_arrays_are_integrated_by_element(connections: list[str], springs: Fmus) -> None:
    systems = (ec.System.of(dict.fromkeys("ab", springs[n]), connections) for n in (2, 3))
    two, three = (run(system, kind={"*": "me"}, set={"a.x[2]": 0.7}) for system in systems)
    for name in ("time", *two.names):
        assert two[name].tobytes() == three[name].tobytes(), name
    assert three.record["stepping"]["integrated_together"] == [["a", "b"]]
    assert np.ptp(three["b.x[2]"]) > 0.01


def test_input_that_a_user_changes_keeps_its_value(springs: Fmus) -> None:
    values = []
    for n in (2, 3):
        system = ec.System.of(dict.fromkeys("ab", springs[n]), ELEMENTS)
        with ec.load(system, kind={"*": "me"}, step_size=STEP, stop_time=STOP).prepare() as simulation:
            simulation.advance(0.5)
            simulation["b.F[1]"] = 3.0
            simulation.advance(STOP)
            values.append([simulation[name] for name in ("a.x[1]", "b.x[1]", "b.x[2]", "b.F[1]")])
    assert values[0] == values[1]
    assert values[1][3] == 3.0


def test_state_matrices_match_fmi_2(springs: Fmus) -> None:
    options = {"kind": {"*": "me"}, "step_size": STEP, "stop_time": 0.1, "matrices": True}
    signals = {"perturb": ["b.F[1]", "a.F[1]"], "read": ["a.y[3]", "b.y[2]"]}
    two, three = (
        ec.linearize(ec.System.of(dict.fromkeys("ab", springs[n]), ELEMENTS), **signals, **options)
        for n in (2, 3)
    )
    assert two.matrices.states == three.matrices.states
    for name in "ABCD":
        assert getattr(two.matrices, name).tobytes() == getattr(three.matrices, name).tobytes(), name


def test_strong_loops_through_elements_converge_to_those_of_fmi_2(springs: Fmus) -> None:
    """Not to the bit: dependencies are those of whole arrays, whose parts have no directional derivatives."""
    options = {"kind": {"*": "me"}, "integrate_together": False, "algorithm": "strong"}
    systems = (ec.System.of(dict.fromkeys("ab", springs[n]), ELEMENTS) for n in (2, 3))
    two, three = (run(system, **options) for system in systems)
    for name in two.names:
        assert three[name] == pytest.approx(two[name], abs=1e-5), name

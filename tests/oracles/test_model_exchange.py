"""Native FMUs through Model Exchange, where the host integrates."""

import ctypes
import math
from collections.abc import Callable
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import fmi2, simulate_fmu
from fmpy.fmi2 import FMU2Model, FMU2Slave

from emla_cosim.fmu.models import MODELS, fmu_path
from tests.support.sessions import (
    DISCARD,
    ERROR,
    OK,
    WARNING,
    Session,
    continuous_states,
    derivatives,
    opened,
    refused,
    set_continuous_states,
    status,
)
from tests.support.toy import Shape


def native(model: str, folder: Path) -> Path:
    return fmu_path(model, "native", folder)


# ---- against co-simulation ---------------------------------------------------------------------

RUNS: dict[str, tuple[dict[str, Any], float, float]] = {
    "EmlaPlant": (
        {
            "u_q": 30.0,
            "u_d": -5.0,
            "F_L": 1e3,
            "d_2": 0.1,
            "d_3": 1.0,
            "d_4": 2.0,
            "v_L": 0.02,
            "i_q": 5.0,
            "i_d": 1.0,
            "motor.L_q": 3e-3,
            "uncertainty.F_2": 0.1,
            "motor.i_N": 30.0,
        },
        0.1,
        2e-3,
    ),
    "EmlaCompliantPlant": (
        {
            "u_q": 30.0,
            "u_d": -5.0,
            "F_L": 1e3,
            "v_L": 0.02,
            "i_q": 5.0,
            "load.v": 0.01,
            "load.m": 2e3,
            "transmission.stiffness": 1e7,
            "transmission.damping": 1e3,
            "motor.i_N": 30.0,
        },
        0.1,
        2e-3,
    ),
    "EmlaMotor": (
        {"u_q": 30.0, "u_d": -5.0, "x_L": 0.24, "v_L": 0.02, "d_3": 1.0, "i_q": 5.0, "motor.L_q": 3e-3},
        0.1,
        1e-3,
    ),
    "EmlaObserver": (
        {"y": 0.5, "i_q_ref": 10.0, "v_hat": 0.1, "m_0": 100.0, "H_0": 10.0},
        0.1,
        1e-2,
    ),
    "RsbaController": (
        {
            "x_hat": 0.25,
            "x_d": 0.24,
            "v_hat": 0.01,
            "i_q": 5.0,
            "i_d": 1.0,
            "limit_acceleration": True,
            **{f"beta[{i}]": 50.0 for i in range(1, 5)},
            **{f"delta[{i}]": 1.0 for i in range(1, 5)},
            **{f"sigma[{i}]": 40.0 for i in range(1, 5)},
        },
        0.1,
        2e-2,
    ),
    "FocController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "omega_d": 50.0,
            "w_c": 100.0,
            "w_i": 40.0,
        },
        0.1,
        2e-2,
    ),
    "CacController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "omega_n[1]": 50.0,
            "omega_n[2]": 80.0,
            "k[1]": 20.0,
            "k[2]": 30.0,
            "limit.i_max": 1e4,
        },
        0.1,
        1e-2,
    ),
    "AnatcController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "k_1": 20.0,
            "g": 10.0,
            "ell[1]": 3.0,
            "ell[2]": 3.0,
        },
        0.1,
        2e-2,
    ),
}
"""Start values of inputs, parameters and states, stop time, and the longest internal step tried."""


@pytest.mark.parametrize("model", RUNS)
def test_co_simulation_converges_to_it_with_fourth_order(
    fmu_folder: Path, tmp_path: Path, model: str
) -> None:
    """CVode at 1e-12: at 1e-10 its own errors of 1e-8 would be seen."""
    values, stop_time, longest = RUNS[model]
    path = native(model, fmu_folder)
    with opened(path, tmp_path) as session:
        states = session.states
        found = simulate_fmu(
            str(path),
            fmi_type="ModelExchange",
            solver="CVode",
            relative_tolerance=1e-12,
            stop_time=stop_time,
            output_interval=stop_time / 100.0,
            start_values=values,
            output=states,
        )
        exchanged = np.array([found[s][-1] for s in states])
        nominals = [float(session.variables[s].nominal or 1.0) for s in states]
        errors = []
        for k in range(5):
            slave = session.instance(**values, **{"solver.internal_step": longest / 2**k})
            slave.doStep(0.0, stop_time)
            stepped = np.array(session.get(slave, *states))
            errors.append(np.max(np.abs(stepped - exchanged) / np.maximum(np.abs(exchanged), nominals)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 3e-8, errors
    assert all(3.8 < order < 4.2 for order in orders[-2:]), orders


def test_a_block_without_states_gives_the_same_outputs(fmu_folder: Path, tmp_path: Path) -> None:
    """The reference, at the host's times instead of after steps."""
    with opened(native("Reference", fmu_folder), tmp_path) as session:
        values, outputs = {"waypoint[2]": 0.3, "move.start[1]": 0.1, "period": 1.25}, ("x_d", "v_d", "a_d")
        model = session.instance("model", of=FMU2Model, **values)
        slave = session.instance("slave", **values)
        time = 0.0
        for step in np.random.default_rng(6).uniform(0.01, 0.2, size=30):
            slave.doStep(time, step)
            time += step
            model.setTime(time)
            model.completedIntegratorStep()
            assert session.get(model, *outputs) == session.get(slave, *outputs)


def test_fmpy_runs_a_block_without_states(fmu_folder: Path) -> None:
    path = str(native("Reference", fmu_folder))
    found = simulate_fmu(path, fmi_type="ModelExchange", stop_time=1.0, start_values={"waypoint[2]": 0.3})
    assert found["x_d"][-1] == pytest.approx(0.3, rel=1e-12)


def test_discrete_states_hold_their_start_values(toy: Session) -> None:
    found = simulate_fmu(
        str(toy.folder),
        fmi_type="ModelExchange",
        stop_time=1.0,
        start_values={"seed": 99, "step_count": 5.0},
        output=["random", "step_count", "x"],
    )
    assert set(found["random"]) == {99.0}
    assert set(found["step_count"]) == {5.0}
    assert len(set(found["x"])) > 100


def test_a_block_with_discrete_states_only_is_for_co_simulation_only(
    fmu_folder: Path, tmp_path: Path
) -> None:
    with opened(native("Disturbance", fmu_folder), tmp_path) as session:
        assert session.description.modelExchange is None
        slave = session.new()
        assert instantiate(session, slave, fmi2.fmi2ModelExchange) is None
        assert session.log.lines("raw") == ["raw: this FMU is for co-simulation only."]


def test_all_other_models_are_for_both(fmu_folder: Path, tmp_path: Path) -> None:
    offering = set()
    for name in MODELS:
        with opened(native(name, fmu_folder), tmp_path / name) as session:
            if session.description.modelExchange is not None:
                session.instance(of=FMU2Model)
                offering.add(name)
    assert offering == MODELS.keys() - {"Disturbance", "SignalFault"}


def instantiate(session: Session, slave: Any, kind: int, guid: str | None = None) -> Any:
    guid = guid or session.description.guid
    return slave.fmi2Instantiate(
        b"raw", kind, guid.encode(), b"file:///", byref(session.log.callbacks), False, True
    )


def test_a_type_that_does_not_exist_is_refused(toy: Session) -> None:
    assert instantiate(toy, toy.new(), 2) is None
    assert toy.log.lines("raw") == ["raw: there is no FMU type 2."]


def test_a_foreign_guid_is_refused(toy: Session) -> None:
    assert instantiate(toy, toy.new(kind=FMU2Model), fmi2.fmi2ModelExchange, "{0}") is None
    assert toy.log.lines("raw")[0].startswith("raw: the GUID {0} is not this FMU's, {")


# ---- what an instance gives --------------------------------------------------------------------


def test_derivatives_are_those_of_the_present_time_states_and_inputs(toy: Session) -> None:
    model = toy.instance(of=FMU2Model, shape=Shape.CUBIC)
    model.setTime(0.75)
    set_continuous_states(model, [0.5, 2.0, -3.0])
    toy.set(model, force=7.0)
    expected = [2.0, (7.0 - 0.25 * 0.5**3 - 0.1 * 2.0) / 2.0, math.cos(0.75) + 1.0]
    assert derivatives(model, 3) == pytest.approx(expected, rel=1e-15)
    assert toy.get(model, "der(x)", "der(v[1])", "der(v[2])") == derivatives(model, 3)
    assert continuous_states(model, 3) == toy.get(model, "x", "v[1]", "v[2]") == [0.5, 2.0, -3.0]


def test_outputs_follow_at_once(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    noise = 3 * 7 / 2147483647
    set_continuous_states(model, [0.5, 2.0, -3.0])
    assert toy.get(model, "power", "inverse") == pytest.approx([0.5 * 2.0 + noise, 2.0], rel=1e-15)
    toy.set(model, force=7.0)
    assert toy.get(model, "power") == pytest.approx([7.0 * 2.0 + noise], rel=1e-15)
    model.enterEventMode()
    toy.set(model, force=8.0)
    assert toy.get(model, "power") == pytest.approx([8.0 * 2.0 + noise], rel=1e-15)


def test_start_values_can_be_read_and_derived_in_initialization(toy: Session) -> None:
    model = toy.instance(of=FMU2Model, running=False, x_0=0.75)
    assert continuous_states(model, 3) == [0.75, 0.5, -0.5]
    assert derivatives(model, 3) == pytest.approx([0.5, (0.5 - 2.25 - 0.05) / 2.0, 1.0 + 0.5 / 3.0])


def test_events_change_nothing_and_announce_nothing(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    before = toy.get(model, "x", "v[1]", "v[2]", "power", "random", "step_count")
    model.enterEventMode()
    assert model.newDiscreteStates() == (False, False, False, False, False, 0.0)
    model.enterContinuousTimeMode()
    assert model.completedIntegratorStep() == (False, False)
    assert toy.get(model, "x", "v[1]", "v[2]", "power", "random", "step_count") == before


def test_nominal_values_are_those_of_the_block(fmu_folder: Path, tmp_path: Path) -> None:
    with opened(native("EmlaPlant", fmu_folder), tmp_path) as session:
        model = session.instance(of=FMU2Model)
        nominals = (fmi2.fmi2Real * 5)()
        model.getNominalsOfContinuousStates(nominals, 5)
        assert list(nominals) == [0.1, 0.1, 10.0, 10.0, 10.0]


@pytest.mark.parametrize(
    ("x", "shape", "complaint"),
    [
        (math.nan, Shape.LINEAR, "toy: der(v[1]) at t = 0.5 s is nan."),
        (1e200, Shape.CUBIC, "toy: der(v[1]) at t = 0.5 s is -inf."),
    ],
)
def test_a_derivative_that_is_not_finite_is_discarded_by_name(
    toy: Session, x: float, shape: Shape, complaint: str
) -> None:
    """The host can then try a shorter step."""
    model = toy.instance(of=FMU2Model, shape=shape)
    model.setTime(0.5)
    set_continuous_states(model, [x, 0.5, 0.5])
    with refused(DISCARD):
        derivatives(model, 3)
    assert toy.log.lines("toy") == [complaint]
    set_continuous_states(model, [0.5, 0.5, 0.5])
    assert np.isfinite(derivatives(model, 3)).all()


@pytest.mark.parametrize("call", ["SetContinuousStates", "GetContinuousStates", "GetDerivatives"])
@pytest.mark.parametrize("n", [0, 2, 4])
def test_arrays_of_another_length_are_refused(toy: Session, call: str, n: int) -> None:
    model = toy.instance(of=FMU2Model)
    with refused():
        getattr(model, f"fmi2{call}")(model.component, (fmi2.fmi2Real * 4)(), n)
    assert toy.log.lines("toy") == [f"toy: the array has {n} values instead of 3."]
    assert continuous_states(model, 3) == [0.125, 0.5, -0.5]


def test_there_are_no_event_indicators(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    indicators = (fmi2.fmi2Real * 1)()
    assert status(model.getEventIndicators, indicators, 0) == OK
    assert status(model.getEventIndicators, indicators, 1) == ERROR


@pytest.mark.parametrize("time", [math.nan, math.inf])
def test_a_time_that_is_no_number_is_refused(toy: Session, time: float) -> None:
    model = toy.instance(of=FMU2Model)
    model.setTime(0.5)
    with refused():
        model.setTime(time)
    assert toy.log.lines("toy") == [f"toy: the time {time} is not a finite number of seconds."]
    assert toy.get(model, "der(v[2])") == pytest.approx([math.cos(0.5) + 0.5 / 3.0])


# ---- phases ------------------------------------------------------------------------------------

CALLS: dict[str, tuple[str, Callable[[Session, FMU2Model], Any]]] = {
    "setup": ("set up the experiment", lambda s, m: m.setupExperiment()),
    "enter initialization": ("enter initialization mode", lambda s, m: m.enterInitializationMode()),
    "exit initialization": ("exit initialization mode", lambda s, m: m.exitInitializationMode()),
    "event": ("enter event mode", lambda s, m: m.enterEventMode()),
    "discrete": ("find new discrete states", lambda s, m: m.newDiscreteStates()),
    "continuous": ("enter continuous-time mode", lambda s, m: m.enterContinuousTimeMode()),
    "completed": ("complete an integrator step", lambda s, m: m.completedIntegratorStep()),
    "set time": ("set the time", lambda s, m: m.setTime(0.5)),
    "set states": ("set continuous states", lambda s, m: set_continuous_states(m, [0.1, 0.2, 0.3])),
    "get states": ("get continuous states", lambda s, m: continuous_states(m, 3)),
    "get derivatives": ("get derivatives", lambda s, m: derivatives(m, 3)),
    "get": ("get values", lambda s, m: s.get(m, "x")),
    "set": ("set values", lambda s, m: s.set(m, force=1.0)),
    "terminate": ("terminate", lambda s, m: m.terminate()),
}
"""Calls, and what the log says of each."""

PHASES = {
    "instantiated": {"setup", "enter initialization", "set"},
    "initialization": {"exit initialization", "get states", "get derivatives", "get", "set"},
    "event": CALLS.keys()
    - {"setup", "enter initialization", "exit initialization", "completed", "set states"},
    "continuous-time": CALLS.keys()
    - {"setup", "enter initialization", "exit initialization", "discrete", "continuous"},
    "terminated": {"get states", "get derivatives", "get"},
}
"""What is allowed in each phase."""


def bring_to(phase: str, model: FMU2Model) -> None:
    for name, call in (
        ("initialization", model.enterInitializationMode),
        ("event", model.exitInitializationMode),
        ("continuous-time", model.enterContinuousTimeMode),
        ("terminated", model.terminate),
    ):
        if list(PHASES).index(name) <= list(PHASES).index(phase):
            call()


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("phase", PHASES)
def test_each_call_has_its_phases(toy: Session, phase: str, call: str) -> None:
    model = toy.new(kind=FMU2Model)
    model.setupExperiment()
    bring_to(phase, model)
    action, make = CALLS[call]
    if call in PHASES[phase]:
        make(toy, model)
        assert toy.log.lines("toy") == []
    else:
        with refused():
            make(toy, model)
        assert toy.log.lines("toy") == [f"toy: cannot {action} in phase {phase}."]


def test_refused_calls_leave_the_instance_as_it_was(toy: Session) -> None:
    """All that are wrong, in every phase of a life that gives the same as one without them."""
    results = []
    for annoyed in (False, True):
        model = toy.new(kind=FMU2Model)
        model.setupExperiment()

        def annoy(phase: str, model: FMU2Model = model, annoyed: bool = annoyed) -> None:
            for name in CALLS.keys() - PHASES[phase] if annoyed else ():
                assert status(CALLS[name][1], toy, model) == ERROR

        annoy("instantiated")
        model.enterInitializationMode()
        annoy("initialization")
        model.exitInitializationMode()
        annoy("event")
        model.enterContinuousTimeMode()
        annoy("continuous-time")
        model.setTime(0.25)
        set_continuous_states(model, [0.5, 1.0, 2.0])
        annoy("continuous-time")
        found = [*derivatives(model, 3), *toy.get(model, "power", "inverse", "force", "random")]
        model.terminate()
        annoy("terminated")
        results.append([*found, *toy.get(model, "power", "x", "der(v[1])")])
    assert results[0] == results[1]


def test_parameters_and_states_cannot_be_set_one_by_one_after_initialization(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    for values in ({"body.mass": 1.0}, {"v[1]": 1.0}, {"power": 1.0}, {"der(x)": 1.0}, {"random": 1.0}):
        with refused():
            toy.set(model, **values)
    assert [line.removeprefix("toy: ") for line in toy.log.lines("toy")] == [
        "body.mass cannot be set after initialization.",
        "v[1] cannot be set after initialization.",
        "power is computed by the block and cannot be set.",
        "der(x) is computed by the block and cannot be set.",
        "random is computed by the block and cannot be set.",
    ]


def test_a_value_out_of_range_ends_no_initialization(toy: Session) -> None:
    model = toy.instance(of=FMU2Model, running=False, **{"body.mass": 11.0})
    with refused():
        model.exitInitializationMode()
    toy.set(model, **{"body.mass": 2.0})
    model.exitInitializationMode()
    model.enterContinuousTimeMode()


def test_a_reset_instance_is_for_model_exchange_again(toy: Session) -> None:
    model = toy.instance(of=FMU2Model, x_0=0.3)
    model.setTime(0.5)
    model.reset()
    toy.initialize(model)
    assert continuous_states(model, 3) == [0.125, 0.5, -0.5]
    assert toy.get(model, "der(v[2])") == pytest.approx([1.0 + 0.5 / 3.0])


# ---- calls of the other type -------------------------------------------------------------------

BUFFER = (c_double * 4)()
FLAG = c_int()
CO_SIMULATION: dict[str, tuple[Any, ...]] = {
    "do a step": ("fmi2DoStep", c_double(0.0), c_double(0.1), c_int(1)),
    "set input derivatives": (
        "fmi2SetRealInputDerivatives",
        byref(c_uint(0)),
        c_size_t(1),
        byref(c_int(1)),
        BUFFER,
    ),
    "get output derivatives": (
        "fmi2GetRealOutputDerivatives",
        byref(c_uint(10)),
        c_size_t(1),
        byref(c_int(1)),
        BUFFER,
    ),
}
MODEL_EXCHANGE: dict[str, tuple[Any, ...]] = {
    "enter event mode": ("fmi2EnterEventMode",),
    "find new discrete states": ("fmi2NewDiscreteStates", byref(fmi2.fmi2EventInfo())),
    "enter continuous-time mode": ("fmi2EnterContinuousTimeMode",),
    "complete an integrator step": ("fmi2CompletedIntegratorStep", c_int(1), byref(FLAG), byref(FLAG)),
    "set the time": ("fmi2SetTime", c_double(0.5)),
    "set continuous states": ("fmi2SetContinuousStates", BUFFER, c_size_t(3)),
}


def call(instance: Any, function: str, *arguments: Any) -> int:
    """A function that fmpy keeps from instances of this type."""
    return ctypes.CDLL(instance.dll._name)[function](c_void_p(instance.component), *arguments)


@pytest.mark.parametrize("action", CO_SIMULATION)
@pytest.mark.parametrize("continuous", [False, True])
def test_calls_of_co_simulation_are_refused(toy: Session, action: str, continuous: bool) -> None:
    model = toy.instance(of=FMU2Model)
    if not continuous:
        model.enterEventMode()
    assert call(model, *CO_SIMULATION[action]) == ERROR
    phase = "continuous-time" if continuous else "event"
    assert toy.log.lines("toy") == [f"toy: cannot {action} in phase {phase}."]
    assert toy.get(model, "x", "force", "step_count") == [0.125, 0.5, 0.0]


@pytest.mark.parametrize("action", MODEL_EXCHANGE)
def test_calls_of_model_exchange_are_refused_in_co_simulation(toy: Session, action: str) -> None:
    slave = toy.instance()
    assert call(slave, *MODEL_EXCHANGE[action]) == ERROR
    assert toy.log.lines("toy") == [f"toy: cannot {action} in phase step."]
    slave.doStep(0.0, 0.1)


# ---- saved states ------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", [(FMU2Slave, FMU2Model), (FMU2Model, FMU2Slave)])
@pytest.mark.parametrize("serialized", [False, True])
def test_a_state_of_one_type_is_refused_by_the_other(
    toy: Session, kinds: tuple[Any, Any], serialized: bool
) -> None:
    source, target = toy.instance("source", of=kinds[0]), toy.instance("target", of=kinds[1])
    before = toy.get(target, "x", "v[1]", "power")
    saved = source.getFMUstate()
    if serialized:
        text = source.serializeFMUstate(saved)
        with refused():
            target.deSerializeFMUstate(text)
    else:
        with refused():
            target.setFMUstate(saved)
    source.freeFMUstate(saved)
    complaint = "target: states of Co-Simulation and Model Exchange are not compatible."
    assert toy.log.lines("target") == [complaint]
    assert toy.get(target, "x", "v[1]", "power") == before


@pytest.mark.parametrize("serialized", [False, True])
def test_a_saved_state_brings_time_states_inputs_and_phase_back(toy: Session, serialized: bool) -> None:
    model, other = toy.instance("model", of=FMU2Model), toy.instance("other", of=FMU2Model)
    model.setTime(0.75)
    set_continuous_states(model, [0.5, 2.0, -3.0])
    toy.set(model, force=7.0)
    expected = derivatives(model, 3)
    saved = model.getFMUstate()
    if serialized:
        saved = other.deSerializeFMUstate(model.serializeFMUstate(saved))
    model.setTime(1.0)
    set_continuous_states(model, [0.1, 0.2, 0.3])
    toy.set(model, force=-1.0)
    model.enterEventMode()
    for each in (model, other):
        each.setFMUstate(saved)
        assert derivatives(each, 3) == expected
        assert continuous_states(each, 3) == [0.5, 2.0, -3.0]
        each.completedIntegratorStep()


def test_going_back_behind_a_promised_point_is_a_warning(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    early = model.getFMUstate()
    model.setTime(0.5)
    model.completedIntegratorStep(True)
    late = model.getFMUstate()
    model.setTime(0.75)
    assert model.fmi2SetFMUstate(model.component, late) == OK
    assert model.fmi2SetFMUstate(model.component, early) == WARNING
    (line,) = toy.log.lines("toy")
    assert line == (
        "toy: set back to t = 0 s, though noSetFMUStatePriorToCurrentPoint was given at t = 0.5 s."
    )
    assert toy.get(model, "der(v[2])") == pytest.approx([1.0 + 0.5 / 3.0])


def test_without_a_promise_going_back_is_fine(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    early = model.getFMUstate()
    model.setTime(0.5)
    model.completedIntegratorStep(False)
    assert model.fmi2SetFMUstate(model.component, early) == OK
    assert toy.log.lines("toy") == []

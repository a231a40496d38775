"""Native FMUs through Model Exchange, where the host integrates."""

import ctypes
import math
from collections.abc import Callable
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from typing import Any

import numpy as np
import pytest
from fmpy import fmi2, simulate_fmu
from fmpy.fmi2 import FMU2Model, FMU2Slave

from tests.support.blocks import FACTS, WITH_STATES
from tests.support.sessions import (
    DISCARD,
    ERROR,
    OK,
    WARNING,
    Session,
    continuous_states,
    derivatives,
    refused,
    set_continuous_states,
    status,
)
from tests.support.toy import Shape

# ---- against co-simulation ---------------------------------------------------------------------


@pytest.mark.parametrize("model", WITH_STATES)
def test_co_simulation_converges_to_model_exchange_with_fourth_order(
    sessions: dict[str, Session], model: str
) -> None:
    """CVode at 1e-12: at 1e-10 its own errors of 1e-8 would be seen."""
    session, facts = sessions[model], FACTS[model]
    states, (stop_time, longest) = session.states, facts.exchange or (0.0, 0.0)
    rows = simulate_fmu(
        str(session.folder),
        fmi_type="ModelExchange",
        solver="CVode",
        relative_tolerance=1e-12,
        stop_time=stop_time,
        output_interval=stop_time / 100.0,
        start_values=dict(facts.smooth),
        output=states,
    )
    exchanged = np.array([rows[s][-1] for s in states])
    nominals = [float(session.variables[s].nominal or 1.0) for s in states]
    errors = []
    for k in range(2, 5):
        slave = session.instance(**facts.smooth, **{"solver.internal_step": longest / 2**k})
        slave.doStep(0.0, stop_time)
        stepped = np.array(session.get(slave, *states))
        errors.append(np.max(np.abs(stepped - exchanged) / np.maximum(np.abs(exchanged), nominals)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 3e-8, errors
    assert all(3.8 < order < 4.2 for order in orders), orders


def test_block_without_states_gives_the_same_outputs(sessions: dict[str, Session]) -> None:
    """The reference, at the host's times instead of after steps."""
    session = sessions["Reference"]
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
    path = str(session.folder)
    rows = simulate_fmu(path, fmi_type="ModelExchange", stop_time=1.0, start_values={"waypoint[2]": 0.3})
    assert rows["x_d"][-1] == pytest.approx(0.3, rel=1e-12)


def test_discrete_states_hold_their_start_values(toy: Session) -> None:
    rows = simulate_fmu(
        str(toy.folder),
        fmi_type="ModelExchange",
        stop_time=1.0,
        start_values={"seed": 99, "step_count": 5.0},
        output=["random", "step_count", "x"],
    )
    assert set(rows["random"]) == {99.0}
    assert set(rows["step_count"]) == {5.0}
    assert len(set(rows["x"])) > 100


@pytest.mark.parametrize("model", ["Disturbance", "ScrewCommand"])
def test_blocks_that_need_steps_are_for_co_simulation_only(sessions: dict[str, Session], model: str) -> None:
    """Because all their states are discrete, or because the block says so."""
    session = sessions[model]
    assert session.description.modelExchange is None
    assert instantiate(session, session.new(), fmi2.fmi2ModelExchange) is None
    assert session.log.lines("raw") == ["raw: this FMU is for co-simulation only."]


def test_other_types_and_guids_are_refused(toy: Session) -> None:
    assert instantiate(toy, toy.new(), 2) is None
    assert instantiate(toy, toy.new(kind=FMU2Model), fmi2.fmi2ModelExchange, "{0}") is None
    lines = toy.log.lines("raw")
    assert lines[0] == "raw: there is no FMU type 2."
    assert lines[1].startswith("raw: the GUID {0} is not this FMU's, {")


def test_models_that_offer_model_exchange(sessions: dict[str, Session]) -> None:
    offering = {m for m, session in sessions.items() if session.description.modelExchange is not None}
    assert offering == {m for m in FACTS if FACTS[m].has_model_exchange}
    for model in offering:
        sessions[model].instance(of=FMU2Model)


def instantiate(session: Session, slave: Any, kind: int, guid: str | None = None) -> Any:
    guid = guid or session.description.guid
    return slave.fmi2Instantiate(
        b"raw", kind, guid.encode(), b"file:///", byref(session.log.callbacks), False, True
    )


# ---- what an instance gives --------------------------------------------------------------------


def test_derivatives_match_the_present_time_states_and_inputs(toy: Session) -> None:
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


def test_events_change_no_values(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    before = toy.get(model, "x", "v[1]", "v[2]", "power", "random", "step_count")
    model.enterEventMode()
    assert model.newDiscreteStates() == (False, False, False, False, False, 0.0)
    model.enterContinuousTimeMode()
    assert model.completedIntegratorStep() == (False, False)
    assert toy.get(model, "x", "v[1]", "v[2]", "power", "random", "step_count") == before


def test_nominal_values_match_the_block(sessions: dict[str, Session]) -> None:
    model = sessions["EmlaPlant"].instance(of=FMU2Model)
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
def test_derivative_that_is_not_finite_is_discarded_by_name(
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


def test_invalid_lengths_and_times_are_refused(toy: Session) -> None:
    model = toy.instance(of=FMU2Model)
    model.setTime(0.5)
    buffer, expected = (fmi2.fmi2Real * 4)(), []
    for name, n in (("SetContinuousStates", 2), ("GetContinuousStates", 4), ("GetDerivatives", 0)):
        assert status(getattr(model, f"fmi2{name}"), model.component, buffer, n) == ERROR
        expected.append(f"toy: the array has {n} values instead of 3.")
    for time in (math.nan, math.inf):
        assert status(model.setTime, time) == ERROR
        expected.append(f"toy: the time {time} is not a finite number of seconds.")
    assert toy.log.lines("toy") == expected
    assert status(model.getEventIndicators, buffer, 0) == OK
    assert status(model.getEventIndicators, buffer, 1) == ERROR  # there are none
    assert continuous_states(model, 3) == [0.125, 0.5, -0.5]
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


def serialized(model: FMU2Model) -> bytes:
    saved = model.getFMUstate()
    state = model.serializeFMUstate(saved)
    model.freeFMUstate(saved)
    return state


@pytest.mark.parametrize("phase", PHASES)
def test_each_call_has_its_phases(toy: Session, phase: str) -> None:
    for name, (action, make) in CALLS.items():
        toy.log.all.clear()
        model = toy.new(kind=FMU2Model)
        model.setupExperiment()
        bring_to(phase, model)
        if name in PHASES[phase]:
            make(toy, model)
            assert toy.log.lines("toy") == []
        else:
            before = serialized(model)
            with refused():
                make(toy, model)
            assert toy.log.lines("toy") == [f"toy: cannot {action} in phase {phase}."]
            assert serialized(model) == before


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


# ---- calls of the other type -------------------------------------------------------------------

BUFFER, FLAG, SINGLE = (c_double * 4)(), c_int(), c_size_t(1)
CO_SIMULATION: dict[str, tuple[Any, ...]] = {
    "do a step": ("fmi2DoStep", c_double(0.0), c_double(0.1), c_int(1)),
    "set input derivatives": (
        "fmi2SetRealInputDerivatives",
        byref(c_uint(0)),
        SINGLE,
        byref(c_int(1)),
        BUFFER,
    ),
    "get output derivatives": (
        "fmi2GetRealOutputDerivatives",
        byref(c_uint(10)),
        SINGLE,
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


def test_calls_of_the_other_type_are_refused(toy: Session) -> None:
    slave, model, paused = toy.instance(), toy.instance(of=FMU2Model), toy.instance(of=FMU2Model)
    paused.enterEventMode()
    for instance, phase, calls in (
        (model, "continuous-time", CO_SIMULATION),
        (paused, "event", CO_SIMULATION),
        (slave, "step", MODEL_EXCHANGE),
    ):
        toy.log.all.clear()
        for arguments in calls.values():
            assert call(instance, *arguments) == ERROR
        assert toy.log.lines("toy") == [f"toy: cannot {action} in phase {phase}." for action in calls]
        assert toy.get(instance, "x", "force", "step_count") == [0.125, 0.5, 0.0]
    slave.doStep(0.0, 0.1)


# ---- saved states ------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", [(FMU2Slave, FMU2Model), (FMU2Model, FMU2Slave)])
def test_state_of_one_type_is_refused_by_the_other(toy: Session, kinds: tuple[Any, Any]) -> None:
    source, target = toy.instance("source", of=kinds[0]), toy.instance("target", of=kinds[1])
    before = toy.get(target, "x", "v[1]", "power")
    saved = source.getFMUstate()
    with refused():
        target.deSerializeFMUstate(source.serializeFMUstate(saved))
    with refused():
        target.setFMUstate(saved)
    source.freeFMUstate(saved)
    complaint = "target: states of Co-Simulation and Model Exchange are not compatible."
    assert toy.log.lines("target") == [complaint] * 2
    assert toy.get(target, "x", "v[1]", "power") == before


@pytest.mark.parametrize("serialized", [False, True])
def test_saved_states_contain_time_states_inputs_and_phase(toy: Session, serialized: bool) -> None:
    model, second = toy.instance("model", of=FMU2Model), toy.instance("other", of=FMU2Model)
    model.setTime(0.75)
    set_continuous_states(model, [0.5, 2.0, -3.0])
    toy.set(model, force=7.0)
    expected = derivatives(model, 3)
    saved = model.getFMUstate()
    if serialized:
        saved = second.deSerializeFMUstate(model.serializeFMUstate(saved))
    model.setTime(1.0)
    set_continuous_states(model, [0.1, 0.2, 0.3])
    toy.set(model, force=-1.0)
    model.enterEventMode()
    for each in (model, second):
        each.setFMUstate(saved)
        assert derivatives(each, 3) == expected
        assert continuous_states(each, 3) == [0.5, 2.0, -3.0]
        each.completedIntegratorStep()


@pytest.mark.parametrize("promised", [True, False])
def test_going_back_behind_a_promised_point_is_a_warning(toy: Session, promised: bool) -> None:
    model = toy.instance(of=FMU2Model)
    first_state = model.getFMUstate()
    model.setTime(0.5)
    model.completedIntegratorStep(promised)
    promised_state = model.getFMUstate()
    model.setTime(0.75)
    assert model.fmi2SetFMUstate(model.component, promised_state) == OK
    assert model.fmi2SetFMUstate(model.component, first_state) == (WARNING if promised else OK)
    line = "toy: set back to t = 0 s, though noSetFMUStatePriorToCurrentPoint was given at t = 0.5 s."
    assert toy.log.lines("toy") == [line] * promised
    assert toy.get(model, "der(v[2])") == pytest.approx([1.0 + 0.5 / 3.0])

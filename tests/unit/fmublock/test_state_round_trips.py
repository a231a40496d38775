"""Saved states of every FMU, of both flavours: continued anywhere, a run gives the same bits."""

import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.fmu.models import FLAVOURS, MODELS, fmu_path
from tests.support.runs import Elsewhere, Job, Run, Step
from tests.support.sessions import ERROR, FATAL, OK, Session, refused, status
from tests.support.tiers import examples

PARAMETERS: dict[str, dict[str, Any]] = {
    "EmlaPlant": {
        "sensor.sigma": 1e-5,
        "sensor.resolution": 1e-6,
        "sensor.seed": 12345,
        "sensor.current.sigma": 0.1,
        "inverter.delay": 3e-3,
        "uncertainty.F_2": 0.1,
        "motor.L_q": 3e-3,
    },
    "EmlaCompliantPlant": {
        "sensor.sigma": 1e-5,
        "sensor.at_load": True,
        "transmission.backlash": 1e-3,
        "start.deflection": 1e-3,
        "inverter.delay": 3e-3,
    },
    "EmlaMotor": {"sensor.sigma": 1e-5, "sensor.current.sigma": 0.1, "inverter.delay": 3e-3},
    "EmlaObserver": {"H_0": 2.0, "start.eta_hat": 3.0},
    "RsbaController": {"limit_acceleration": True, "limit_current": True, "freeze_adaptation": True},
    "FocController": {"omega_d": 500.0},
    "CacController": {},
    "AnatcController": {},
    "Reference": {"waypoint[2]": 0.3, "move.start[1]": 1e-4, "move.duration[1]": 5e-3},
    "Trajectory": {f"knot[{i}]": 2e-2 for i in range(7, 55)},
    "Disturbance": {
        "d_2.low": -1.0,
        "d_2.high": 2.0,
        "d_2.arctan": 3.0,
        "d_2.decay": 5.0,
        "load.ripple": 9.0,
    },
    "SignalFault": {"freeze": True, "start": 1e-3, "duration": 2e-3},
    "HdrmManipulator": {"lift.a": 1.2},
    "HdrmPlant": {"start.v_L[1]": 0.1, "screw.B_BS[2]": 50.0, "uncertainty.F_2[3]": 0.1},
}
"""Start values that make noise, memory and limits act."""

LARGEST = {
    "V": 400.0,
    "A": 100.0,
    "m": 0.5,
    "m/s": 0.3,
    "m/s2": 2.0,
    "N": 6e4,
    "N.m": 100.0,
    "kg": 500.0,
    None: 0.5,
}
"""Inputs up to which they are drawn, by unit."""

TWO_STEPS = [Step(1e-3), Step(2e-3)]


@pytest.fixture(scope="session")
def elsewhere() -> Iterator[Elsewhere]:
    process = Elsewhere()
    yield process
    process.close()


@pytest.fixture(scope="module")
def sessions(
    python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[tuple[str, str], Session]]:
    folder = tmp_path_factory.mktemp("round_trips")
    found = {
        (model, flavour): Session(fmu_path(model, flavour, python_fmu_folder), folder / model / flavour)
        for model in MODELS
        for flavour in FLAVOURS
    }
    yield found
    for session in found.values():
        session.close()


def start(session: Session, name: str) -> Any:
    return session.instance(name, **PARAMETERS[session.description.modelName])


def free(session: Session, *slaves: Any) -> None:
    for slave in slaves:
        session.slaves.remove(slave)
        slave.freeInstance()


@st.composite
def steps(draw: Any, session: Session, moving: bool) -> Step:
    """A step of any length, with new inputs or not."""
    units = [session.variables[n].unit for n in session.names("input")]
    values = st.tuples(*(st.floats(-LARGEST[u], LARGEST[u]) for u in units))
    inputs = draw(st.none() | values)
    slopes = draw(st.just(()) | values) if moving else ()
    return Step(draw(st.floats(1e-6, 1e-3)), inputs, slopes)


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
@given(data=st.data())
@examples(3, 20)
def test_a_run_goes_on_from_a_saved_state_bit_for_bit(
    sessions: dict[tuple[str, str], Session],
    elsewhere: Elsewhere,
    model: str,
    flavour: str,
    data: st.DataObject,
) -> None:
    """In the same instance, in a second one, and in another process; inputs may be set already."""
    session = sessions[model, flavour]
    moving = flavour == "native" and bool(session.names("input"))
    any_step = steps(session, moving)
    before, pending, after = (
        data.draw(st.lists(any_step, max_size=8), label="before"),
        data.draw(any_step, label="set, but not stepped yet"),
        [Step(data.draw(st.floats(1e-6, 1e-3))), *data.draw(st.lists(any_step, max_size=4), label="after")],
    )
    folder = str(session.folder)
    slave, second = start(session, "first"), session.new("second")
    run = Run(slave, folder)
    run.go_on(before)
    run.set(pending)
    time, saved = run.time, slave.getFMUstate()
    state = slave.serializeFMUstate(saved)
    expected = run.go_on(after)

    slave.setFMUstate(saved)
    slave.freeFMUstate(saved)
    assert Run(slave, folder, time).go_on(after) == expected

    copy = second.deSerializeFMUstate(state)
    second.setFMUstate(copy)
    second.freeFMUstate(copy)
    assert Run(second, folder, time).go_on(after) == expected

    assert elsewhere.do(Job(folder, state, time, tuple(after))) == expected
    free(session, slave, second)


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
def test_a_state_saved_in_initialization_carries_what_was_set(
    sessions: dict[tuple[str, str], Session], model: str, flavour: str
) -> None:
    session, folder = sessions[model, flavour], str(sessions[model, flavour].folder)
    slave = session.instance("first", running=False, time=0.5, **PARAMETERS[model])
    second = session.new("second")
    saved = slave.getFMUstate()
    copy = second.deSerializeFMUstate(slave.serializeFMUstate(saved))
    second.setFMUstate(copy)
    second.freeFMUstate(copy)
    slave.freeFMUstate(saved)
    slave.exitInitializationMode()
    second.exitInitializationMode()
    expected = Run(slave, folder, 0.5).go_on(TWO_STEPS)
    assert Run(second, folder, 0.5).go_on(TWO_STEPS) == expected
    assert [found for found, _ in expected] == [OK, OK]
    free(session, slave, second)


# ---- what is no state --------------------------------------------------------------------------


def damaged(draw: Any, state: bytes) -> bytes:
    """Cut off, with something more, or with bits flipped."""
    kind = draw(st.sampled_from(["shorter", "longer", "one bit", "a byte"]))
    if kind == "shorter":
        return state[: draw(st.integers(1, len(state) - 1))]
    if kind == "longer":
        return state + draw(st.binary(min_size=1, max_size=16))
    place = draw(st.integers(0, len(state) - 1))
    change = 1 << draw(st.integers(0, 7)) if kind == "one bit" else draw(st.integers(1, 255))
    return state[:place] + bytes([state[place] ^ change]) + state[place + 1 :]


def refuse(session: Session, slave: Any, state: bytes, flavour: str) -> str:
    """What the log says when the instance is given this state.

    PythonFMU has no way to fail while deserializing; its slave refuses the result.
    """
    session.log.all.clear()
    if flavour == "native":
        with refused(ERROR):
            slave.deSerializeFMUstate(state)
    else:
        copy = slave.deSerializeFMUstate(state)
        with refused(FATAL):
            slave.setFMUstate(copy)
        slave.freeFMUstate(copy)
    (line,) = session.log.lines("target")
    return line


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
@given(data=st.data())
@examples(4, 15)
def test_a_damaged_state_is_refused_and_the_run_goes_on(
    sessions: dict[tuple[str, str], Session], model: str, flavour: str, data: st.DataObject
) -> None:
    session, folder = sessions[model, flavour], str(sessions[model, flavour].folder)
    target, straight = start(session, "target"), start(session, "straight")
    runs = [Run(slave, folder) for slave in (target, straight)]
    for run in runs:
        run.go_on(TWO_STEPS)
    saved = target.getFMUstate()
    state = target.serializeFMUstate(saved)
    target.freeFMUstate(saved)
    refuse(session, target, damaged(data.draw, state), flavour)
    assert runs[0].values() == runs[1].values()
    assert runs[0].go_on(TWO_STEPS) == runs[1].go_on(TWO_STEPS)
    free(session, target, straight)


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
def test_a_foreign_state_is_refused_and_the_run_goes_on(
    sessions: dict[tuple[str, str], Session], model: str, flavour: str
) -> None:
    """Of every other model, and of the other flavour."""
    session, folder = sessions[model, flavour], str(sessions[model, flavour].folder)
    target, straight = start(session, "target"), start(session, "straight")
    runs = [Run(slave, folder) for slave in (target, straight)]
    for other in sessions.keys() - {(model, flavour)}:
        stranger = start(sessions[other], "stranger")
        saved = stranger.getFMUstate()
        state = stranger.serializeFMUstate(saved)
        stranger.freeFMUstate(saved)
        free(sessions[other], stranger)
        refuse(session, target, state, flavour)
        assert runs[0].go_on(TWO_STEPS) == runs[1].go_on(TWO_STEPS)
    free(session, target, straight)


def test_the_python_flavour_refuses_a_whole_state_of_another_content(
    sessions: dict[tuple[str, str], Session],
) -> None:
    """The same model with other equations: everything but the hash of its content fits."""
    session = sessions["RsbaController", "python"]
    target, straight = start(session, "target"), start(session, "straight")
    runs = [Run(slave, str(session.folder)) for slave in (target, straight)]
    for run in runs:
        run.go_on(TWO_STEPS)
    saved = target.getFMUstate()
    state = json.loads(target.serializeFMUstate(saved)[8:])
    target.freeFMUstate(saved)

    def serialized(content: str) -> bytes:
        text = json.dumps({**state, "content": content}).encode()
        return b"%08x" % zlib.crc32(text) + text

    own = target.deSerializeFMUstate(serialized(state["content"]))
    target.setFMUstate(own)
    target.freeFMUstate(own)
    other = serialized(f"{int(state['content'], 16) ^ 1:0{len(state['content'])}x}")
    assert "this is not a state of RsbaController." in refuse(session, target, other, "python")
    assert runs[0].go_on(TWO_STEPS) == runs[1].go_on(TWO_STEPS)
    free(session, target, straight)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_nothing_is_no_state(sessions: dict[tuple[str, str], Session], flavour: str) -> None:
    session = sessions["Reference", flavour]
    target = start(session, "target")
    refuse(session, target, b"", flavour)
    assert status(target.doStep, 0.0, 1e-3) == OK
    free(session, target)


def test_the_log_says_what_is_wrong_with_a_state(sessions: dict[tuple[str, str], Session]) -> None:
    """Of native FMUs, which tell a damaged state from a foreign one."""
    session = sessions["Reference", "native"]
    target = start(session, "target")
    saved = target.getFMUstate()
    state = target.serializeFMUstate(saved)
    target.freeFMUstate(saved)
    guid = session.description.guid
    size = len(state)
    for text, complaint in (
        (state[:-1], f"a state has {size} bytes, not {size - 1}."),
        (bytes([state[0] ^ 1]) + state[1:], f"this is not a state of Reference {guid}."),
        (state[:-1] + bytes([state[-1] ^ 1]), "the serialized state is damaged."),
        (state[:100] + bytes([state[100] ^ 128]) + state[101:], "the serialized state is damaged."),
    ):
        assert refuse(session, target, text, "native") == f"target: {complaint}"
    free(session, target)

"""Saved states of every FMU, of both flavours: continued anywhere, a run gives the same bits."""

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.fmu.models import FLAVOURS, fmu_path
from tests.support.blocks import FACTS, OWN
from tests.support.sessions import ERROR, FATAL, OK, Session, refused, status
from tests.support.tiers import examples


@dataclass(frozen=True)
class Step:
    """Sets all inputs, or leaves them; native FMUs can let them move as well."""

    size: float
    inputs: tuple[float, ...] | None = None
    slopes: tuple[float, ...] = ()


class Run:
    """Steps of one instance and, after each, its status and the bits of every Real variable."""

    def __init__(self, session: Session, slave: Any, time: float = 0.0) -> None:
        self.slave, self.time = slave, time
        self.inputs = session.references(session.names("input"))
        self.everything = [v.valueReference for v in session.variables.values() if v.type == "Real"]

    def values(self) -> bytes:
        actual = self.slave.getReal(self.everything)
        return struct.pack(f"{len(actual)}d", *actual)

    def set(self, step: Step) -> None:
        if step.inputs is not None:
            self.slave.setReal(self.inputs, step.inputs)
        if step.slopes:
            self.slave.setRealInputDerivatives(self.inputs, [1] * len(self.inputs), step.slopes)

    def go_on(self, steps: Sequence[Step]) -> list[tuple[int, bytes]]:
        actual = []
        for step in steps:
            self.set(step)
            result = status(self.slave.doStep, self.time, step.size, False)
            if result == OK:
                self.time += step.size
            actual.append((result, self.values()))
        return actual


TWO_STEPS = [Step(1e-3), Step(2e-3)]
Sessions = dict[tuple[str, str], Session]
EACH = pytest.mark.parametrize("key", [(m, f) for m in OWN for f in FLAVOURS], ids="-".join)


@pytest.fixture(scope="module")
def sessions(python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sessions]:
    folder = tmp_path_factory.mktemp("round_trips")
    opened = {
        (model, flavour): Session(fmu_path(model, flavour, python_fmu_folder), folder / model / flavour)
        for model in OWN
        for flavour in FLAVOURS
    }
    yield opened
    for session in opened.values():
        session.close()


def start(session: Session, name: str, **options: Any) -> Any:
    return session.instance(name, **options, **FACTS[session.description.modelName].start)


def free(session: Session, *slaves: Any) -> None:
    for slave in slaves:
        session.slaves.remove(slave)
        slave.freeInstance()


def serialized(slave: Any) -> bytes:
    saved = slave.getFMUstate()
    state = slave.serializeFMUstate(saved)
    slave.freeFMUstate(saved)
    return state


def restore(slave: Any, state: bytes) -> None:
    copy = slave.deSerializeFMUstate(state)
    slave.setFMUstate(copy)
    slave.freeFMUstate(copy)


@st.composite
def steps(draw: Any, session: Session, moving: bool) -> Step:
    """A step of any length, with new inputs or not."""
    sizes = FACTS[session.description.modelName].inputs.values()
    values = st.tuples(*(st.floats(-size, size) for size in sizes))
    inputs = draw(st.none() | values)
    slopes = draw(st.just(()) | values) if moving else ()
    return Step(draw(st.floats(1e-5, 1e-3)), inputs, slopes)


@EACH
@given(data=st.data())
@examples(2, 20)
def test_saved_state_continues_with_the_same_bits_in_any_instance(
    sessions: Sessions, key: tuple[str, str], data: st.DataObject
) -> None:
    """In the same instance and in a second one; inputs may be set already."""
    session = sessions[key]
    any_step = steps(session, key[1] == "native" and bool(session.names("input")))
    before, pending, after = (
        data.draw(st.lists(any_step, max_size=8), label="before"),
        data.draw(any_step, label="set, but not stepped yet"),
        [Step(data.draw(st.floats(1e-5, 1e-3))), *data.draw(st.lists(any_step, max_size=4), label="after")],
    )
    slave, second = start(session, "first"), session.new("second")
    run = Run(session, slave)
    run.go_on(before)
    run.set(pending)
    time, saved = run.time, slave.getFMUstate()
    state = slave.serializeFMUstate(saved)
    expected = run.go_on(after)

    slave.setFMUstate(saved)
    slave.freeFMUstate(saved)
    assert Run(session, slave, time).go_on(after) == expected
    restore(second, state)
    assert Run(session, second, time).go_on(after) == expected
    free(session, slave, second)


@EACH
def test_state_saved_in_initialization_contains_start_values(
    sessions: Sessions, key: tuple[str, str]
) -> None:
    session = sessions[key]
    slave, second = start(session, "first", running=False, time=0.5), session.new("second")
    restore(second, serialized(slave))
    runs = []
    for each in (slave, second):
        each.exitInitializationMode()
        runs.append(Run(session, each, 0.5).go_on(TWO_STEPS))
    assert runs[0] == runs[1] and [result for result, _ in runs[0]] == [OK, OK]
    free(session, slave, second)


# ---- states that are refused -------------------------------------------------------------------


def damaged(draw: Any, state: bytes) -> bytes:
    kind = draw(st.sampled_from(["shorter", "longer", "changed"]))
    if kind == "shorter":
        return state[: draw(st.integers(1, len(state) - 1))]
    if kind == "longer":
        return state + draw(st.binary(min_size=1, max_size=16))
    position = draw(st.integers(0, len(state) - 1))
    changed = bytes([state[position] ^ draw(st.integers(1, 255))])
    return state[:position] + changed + state[position + 1 :]


def refusal(session: Session, slave: Any, state: bytes, flavour: str) -> str:
    """Return the log message when the instance gets this state.

    PythonFMU cannot fail while deserializing; its slave refuses the result.
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


@EACH
@given(data=st.data())
@examples(2, 15)
def test_damaged_and_foreign_states_are_refused(
    sessions: Sessions, key: tuple[str, str], data: st.DataObject
) -> None:
    """Foreign: of another model, of the same model in the other flavour, or empty."""
    session = sessions[key]
    target, straight = start(session, "target"), start(session, "straight")
    runs = [Run(session, slave) for slave in (target, straight)]
    for run in runs:
        run.go_on(TWO_STEPS)
    model, flavour = key
    neighbour = OWN[(OWN.index(model) + 1) % len(OWN)]
    other_flavour = FLAVOURS[1 - FLAVOURS.index(flavour)]
    bad = [damaged(data.draw, serialized(target)), b""]
    for foreign in ((neighbour, flavour), (model, other_flavour), (neighbour, other_flavour)):
        stranger = start(sessions[foreign], "stranger")
        bad.append(serialized(stranger))
        free(sessions[foreign], stranger)
    for state in bad:
        refusal(session, target, state, flavour)
    assert runs[0].values() == runs[1].values()
    assert runs[0].go_on(TWO_STEPS) == runs[1].go_on(TWO_STEPS)
    free(session, target, straight)


def test_python_flavour_refuses_a_state_of_other_equations(sessions: Sessions) -> None:
    """Everything but the hash of the content fits."""
    session = sessions["RsbaController", "python"]
    target = start(session, "target")
    Run(session, target).go_on(TWO_STEPS)
    state = json.loads(serialized(target)[8:])

    def with_content(content: str) -> bytes:
        text = json.dumps({**state, "content": content}).encode()
        return b"%08x" % zlib.crc32(text) + text

    restore(target, with_content(state["content"]))
    foreign = with_content(f"{int(state['content'], 16) ^ 1:0{len(state['content'])}x}")
    assert "this is not a state of RsbaController." in refusal(session, target, foreign, "python")
    assert status(target.doStep, 3e-3, 1e-3) == OK
    free(session, target)


def test_messages_about_states_of_native_fmus(sessions: Sessions) -> None:
    session = sessions["Reference", "native"]
    target = start(session, "target")
    state, size = serialized(target), len(serialized(target))
    for text, complaint in (
        (state[:-1], f"a state has {size} bytes, not {size - 1}."),
        (bytes([state[0] ^ 1]) + state[1:], f"this is not a state of Reference {session.description.guid}."),
        (state[:-1] + bytes([state[-1] ^ 1]), "the serialized state is damaged."),
        (state[:100] + bytes([state[100] ^ 128]) + state[101:], "the serialized state is damaged."),
    ):
        assert refusal(session, target, text, "native") == f"target: {complaint}"
    free(session, target)

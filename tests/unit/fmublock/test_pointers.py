"""NULL where the FMI wants a name, a place to write to or something to read from."""

import ctypes
from collections.abc import Sequence
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any

import pytest
from fmpy.fmi2 import FMU2Model, fmi2LastSuccessfulTime, fmi2Terminated

from tests.support.sessions import ERROR, OK, Session, opened
from tests.support.toy import Toy

NULL = c_void_p(None)
REFERENCE = (c_uint * 1)(Toy.layout().reference("force"))
COUNT = (c_uint * 1)(Toy.layout().reference("count"))
DAMPED = (c_uint * 1)(Toy.layout().reference("damped"))
VALUE, ORDER = (c_double * 1)(0.5), (c_int * 1)(1)
SINGLE = c_size_t(1)
ARRAY = "1 values were announced, but the array is NULL."


def answer(slave: Any, function: str, *arguments: Any) -> int:
    """The status of a function of the library, called as a host in C would."""
    library = ctypes.CDLL(slave.dll._name)
    return library[function](c_void_p(slave.component), *arguments)


def instantiate(session: Session, name: bytes | None) -> int | None:
    """The address of a new instance, or None."""
    function = ctypes.CDLL(session.new("loaded").dll._name)["fmi2Instantiate"]
    function.restype = c_void_p
    resources = (session.folder / "resources").as_uri().encode()
    callbacks = byref(session.log.callbacks)
    return function(
        c_char_p(name), 1, c_char_p(session.description.guid.encode()), c_char_p(resources), callbacks, 0, 1
    )


@pytest.mark.parametrize(("name", "message"), [(None, "NULL"), (b"", "empty")])
def test_instance_needs_a_name(session: Session, name: bytes | None, message: str) -> None:
    assert instantiate(session, name) is None
    assert session.log.all == [
        ("Toy", ERROR, "logStatusError", f"Toy: an instance needs a name; this one is {message}.")
    ]


def test_instance_of_the_python_flavour_needs_a_name(python_toy_fmu: Path, tmp_path: Path) -> None:
    """PythonFMU's library itself ends the process where the name is NULL."""
    with opened(python_toy_fmu, tmp_path / "fmu") as session:
        for _ in range(20):
            assert instantiate(session, b"") is None
        assert all("an instance needs a name; this one is empty." in line.text for line in session.log.all)
        assert len(session.log.all) == 20
        slave = session.instance("named")
        slave.doStep(0.0, 0.1)
        assert session.get(slave, "step_count") == [1.0]


CO_SIMULATION: list[tuple[str, Sequence[Any], str]] = [
    ("fmi2GetReal", (REFERENCE, SINGLE, NULL), ARRAY),
    ("fmi2GetReal", (NULL, SINGLE, VALUE), ARRAY),
    ("fmi2SetReal", (REFERENCE, SINGLE, NULL), ARRAY),
    ("fmi2SetReal", (NULL, SINGLE, VALUE), ARRAY),
    ("fmi2GetInteger", (COUNT, SINGLE, NULL), ARRAY),
    ("fmi2SetInteger", (COUNT, SINGLE, NULL), ARRAY),
    ("fmi2GetBoolean", (DAMPED, SINGLE, NULL), ARRAY),
    ("fmi2SetBoolean", (DAMPED, SINGLE, NULL), ARRAY),
    ("fmi2GetString", (REFERENCE, SINGLE, NULL), ARRAY),
    ("fmi2SetString", (NULL, SINGLE, NULL), ARRAY),
    ("fmi2SetDebugLogging", (c_int(1), SINGLE, NULL), ARRAY),
    ("fmi2GetDirectionalDerivative", (NULL, SINGLE, REFERENCE, SINGLE, VALUE, VALUE), ARRAY),
    ("fmi2GetDirectionalDerivative", (REFERENCE, SINGLE, REFERENCE, SINGLE, VALUE, NULL), ARRAY),
    ("fmi2GetDirectionalDerivative", (REFERENCE, SINGLE, NULL, SINGLE, VALUE, VALUE), ARRAY),
    ("fmi2GetDirectionalDerivative", (REFERENCE, SINGLE, REFERENCE, SINGLE, NULL, VALUE), ARRAY),
    ("fmi2SetRealInputDerivatives", (REFERENCE, SINGLE, NULL, VALUE), ARRAY),
    ("fmi2SetRealInputDerivatives", (REFERENCE, SINGLE, ORDER, NULL), ARRAY),
    ("fmi2GetRealOutputDerivatives", (REFERENCE, SINGLE, NULL, VALUE), ARRAY),
    ("fmi2GetRealOutputDerivatives", (REFERENCE, SINGLE, ORDER, NULL), ARRAY),
    ("fmi2GetFMUstate", (NULL,), "the pointer to the state is NULL."),
    ("fmi2SetFMUstate", (NULL,), "this is not a state of Toy"),
    ("fmi2SerializedFMUstateSize", (NULL, byref(c_size_t())), "this is not a state of Toy"),
    ("fmi2SerializeFMUstate", (NULL, VALUE, c_size_t(8)), "this is not a state of Toy"),
    ("fmi2DeSerializeFMUstate", (NULL, c_size_t(8), byref(c_void_p())), "the pointer to the bytes is NULL."),
    ("fmi2GetRealStatus", (c_int(fmi2LastSuccessfulTime), NULL), "the pointer to the status is NULL."),
    ("fmi2GetBooleanStatus", (c_int(fmi2Terminated), NULL), "the pointer to the status is NULL."),
]


MODEL_EXCHANGE: list[tuple[str, Sequence[Any]]] = [
    ("fmi2SetContinuousStates", (NULL, c_size_t(3))),
    ("fmi2GetContinuousStates", (NULL, c_size_t(3))),
    ("fmi2GetNominalsOfContinuousStates", (NULL, c_size_t(3))),
    ("fmi2GetDerivatives", (NULL, c_size_t(3))),
    ("fmi2CompletedIntegratorStep", (c_int(1), NULL, byref(c_int()))),
    ("fmi2CompletedIntegratorStep", (c_int(1), byref(c_int()), NULL)),
]


def test_null_arrays_and_pointers_are_refused(session: Session) -> None:
    slave = session.instance()
    saved = slave.getFMUstate()
    size = c_size_t(len(slave.serializeFMUstate(saved)))
    of_a_state = [
        ("fmi2SerializedFMUstateSize", (saved, NULL), "the pointer to the size is NULL."),
        ("fmi2SerializeFMUstate", (saved, NULL, size), "the pointer to the bytes is NULL."),
        (
            "fmi2DeSerializeFMUstate",
            (slave.serializeFMUstate(saved), size, NULL),
            "the pointer to the state is NULL.",
        ),
    ]
    for function, arguments, sentence in (*CO_SIMULATION, *of_a_state):
        session.log.all.clear()
        assert answer(slave, function, *arguments) == ERROR, function
        (line,) = session.log.lines("toy")
        assert line.startswith(f"toy: {sentence}"), function
    assert answer(slave, "fmi2FreeFMUstate", NULL) == OK
    slave.freeFMUstate(saved)
    slave.doStep(0.0, 0.1)  # still usable


def test_model_exchange_refuses_null(session: Session) -> None:
    model = session.instance(of=FMU2Model)
    for function, arguments in MODEL_EXCHANGE:
        session.log.all.clear()
        assert answer(model, function, *arguments) == ERROR, function
        (line,) = session.log.lines("toy")
        assert line.endswith(" is NULL."), function
    model.enterEventMode()
    assert answer(model, "fmi2NewDiscreteStates", NULL) == ERROR
    assert session.log.lines("toy")[-1] == "toy: the pointer to the event information is NULL."


def test_no_values_need_no_arrays(session: Session) -> None:
    slave, none = session.instance(), c_size_t(0)
    for name in ("Real", "Integer", "Boolean", "String"):
        for verb in ("Get", "Set"):
            assert answer(slave, f"fmi2{verb}{name}", NULL, none, NULL) == OK
    assert answer(slave, "fmi2GetDirectionalDerivative", NULL, none, NULL, none, NULL, NULL) == OK
    for function in ("fmi2SetRealInputDerivatives", "fmi2GetRealOutputDerivatives"):
        assert answer(slave, function, NULL, none, NULL, NULL) == OK
    assert answer(slave, "fmi2SetDebugLogging", c_int(1), none, NULL) == OK

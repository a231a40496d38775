"""Say what was found in the terms of the FMU's version: names of functions, and sentences of the standard.

Checks name functions and elements as FMI 2.0 does.
"""

import re
from collections.abc import Mapping
from dataclasses import replace

from .verdict import CheckOutcome

# functions of FMI 2.0 that have another name in FMI 3.0; others differ in the first letters only
_FUNCTIONS = {
    "CallbackFunctions": "LogMessageCallback",
    "DeSerializeFMUstate": "DeserializeFMUState",
    "FreeFMUstate": "FreeFMUState",
    "GetFMUstate": "GetFMUState",
    "GetReal": "GetFloat64",
    "GetRealOutputDerivatives": "GetOutputDerivatives",
    "NewDiscreteStates": "UpdateDiscreteStates",
    "SerializeFMUstate": "SerializeFMUState",
    "SerializedFMUstateSize": "SerializedFMUStateSize",
    "SetFMUstate": "SetFMUState",
    "SetReal": "SetFloat64",
    "SetXXX": "Set{VariableType}",
}

FLAGS = {
    "canGetAndSetFMUstate": "canGetAndSetFMUState",
    "canSerializeFMUstate": "canSerializeFMUState",
    "providesDirectionalDerivative": "providesDirectionalDerivatives",
}
"""Capability flags of FMI 2.0 that have another name in FMI 3.0."""

_NAMES = {"GUID": "instantiation token", **FLAGS}
"""Names in messages of checks."""

_IN_CATALOGUE = {
    "fmuGUID": "instantiationToken",
    "SimpleTypes": "type definitions",
    "SimpleType": "type definition",
    "ScalarVariables": "variables",
    "SourceFiles": "buildDescription.xml",
    "FMI 2.0": "FMI 3.0",
    "2.2.7": "2.4.7",
}
"""More names, in titles and hints of checks."""


def say(text: str, version: int) -> str:
    """Return a message of a check in the terms of a version of FMI, 2 or 3."""
    if version == 2:
        return text
    text = re.sub(r"\bfmi2([A-Z]\w*)", lambda m: f"fmi3{_FUNCTIONS.get(m[1], m[1])}", text)
    return _replace(text, _NAMES)


def say_in_catalogue(text: str, version: int) -> str:
    """Return a title, hint or description of a check in the terms of a version of FMI."""
    return text if version == 2 else say(_replace(text, _IN_CATALOGUE), version)


def _replace(text: str, names: Mapping[str, str]) -> str:
    return re.sub("|".join(rf"\b{re.escape(name)}\b" for name in names), lambda m: names[m[0]], text)


def translate(version: int, outcome: CheckOutcome) -> CheckOutcome:
    """Return an outcome with the names and clauses of a version of FMI, and with its details written."""
    quoted, details = outcome.clause, [say(line, version) for line in outcome.details]
    for line, clause in outcome.lines:
        own_clause = None if clause is None or clause == quoted else clause.of(version)
        details.append(
            say(line, version)
            + (f" ({own_clause}: “{own_clause.sentence}”)" if own_clause is not None else "")
        )
    return replace(
        outcome,
        sentence=say(outcome.sentence, version),
        details=tuple(details),
        hint=say_in_catalogue(outcome.hint, version),
        clause=None if quoted is None else quoted.of(version),
        gaps=tuple(say(gap, version) for gap in outcome.gaps),
        lines=(),
    )

"""Messages between a worker and its processes that run variants."""

ANSWER, ERROR, READY, OUTCOME = "answer", "error", "ready", "outcome"
"""Kinds of messages: the answer, an exception, the simulation is prepared, and the outcome of a variant."""

PAYLOAD = "payload.pickle"
"""The file with prepared systems and registered objects, beside the FMUs of a sweep."""

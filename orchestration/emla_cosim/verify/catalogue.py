"""All checks, in the order in which they are done and shown: what a check needs stands before it."""

from .check import Check
from .checks import (
    archive,
    calls,
    dependencies,
    derivatives,
    description,
    exchange,
    instances,
    logs,
    model_exchange,
    runs,
    states,
)

CHECKS: tuple[Check, ...] = (
    archive.safe,
    description.readable,
    instances.created,
    instances.guid,
    runs.completes,
    runs.finite,
    runs.ranges,
    runs.deterministic,
    instances.cycles,
    instances.independent,
    instances.threads,
    instances.reset,
    calls.phases,
    calls.nonfinite,
    states.restored,
    states.serialized,
    derivatives.directional,
    derivatives.of_outputs,
    dependencies.observed,
    exchange.order,
    exchange.split,
    model_exchange.runs,
    model_exchange.agrees,
    logs.categories,
)

"""All checks, in the order in which they are done and shown: what a check needs stands before it."""

from .check import Check
from .checks import (
    archive,
    binaries,
    calls,
    dependencies,
    derivatives,
    description,
    documents,
    exchange,
    experiment,
    imports,
    instances,
    logs,
    model_exchange,
    references,
    runs,
    semantics,
    sources,
    starts,
    states,
    structure,
    systems,
    types,
    units,
    variables,
)

READING: tuple[Check, ...] = (
    description.identifier,
    description.capabilities,
    description.categories,
    experiment.experiment,
    types.types,
    units.defined,
    units.consistent,
    variables.names,
    variables.attributes,
    starts.presence,
    starts.ranges,
    variables.aliases,
    structure.outputs,
    structure.derivatives,
    structure.initial_unknowns,
    structure.dependencies,
    units.derivatives,
    semantics.semantics,
)
"""Of a model description that keeps the schema, so that no process of its own is needed for each."""

STATIC: tuple[Check, ...] = (
    archive.safe,
    archive.format_,
    archive.layout,
    description.readable,
    description.encoding,
    description.schema,
    *READING,
    binaries.present,
    binaries.symbols,
    imports.imports,
    binaries.loads,
    sources.compile_,
    documents.present,
)
"""Of the file alone; nothing of it is run, but for what its library does when it is loaded."""

DYNAMIC: tuple[Check, ...] = (
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
"""Of what the FMU does when it is called."""

CHECKS: tuple[Check, ...] = (*STATIC, *DYNAMIC, references.agrees)

RECORDED = references.recorded
"""What is done instead where references are to be made."""

SYSTEM = (systems.runs, systems.agrees)
"""What is asked of a whole system: the latter where there is a run to hold it against."""

"""All checks, in the order in which they are done and shown: what a check needs stands before it."""

from .check import Check
from .checks import (
    archive,
    binaries,
    description,
    documents,
    experiment,
    imports,
    instances,
    references,
    runs,
    semantics,
    sources,
    starts,
    structure,
    types,
    units,
    variables,
)

STATIC: tuple[Check, ...] = (
    archive.safe,
    archive.format_,
    archive.layout,
    description.readable,
    description.encoding,
    description.schema,
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
    binaries.present,
    binaries.symbols,
    imports.imports,
    binaries.loads,
    sources.compile_,
    documents.present,
)
"""Of the file alone; nothing of it is run, but for what its library does when it is loaded."""

CHECKS: tuple[Check, ...] = (
    *STATIC,
    instances.created,
    runs.completes,
    runs.finite,
    references.agrees,
)

RECORDED = references.recorded
"""What is done instead where references are to be made."""

"""All checks, in the order in which they run and appear: each check comes after those that it needs."""

from .check import Check
from .checks import (
    archive,
    behavior,
    binaries,
    builds,
    calls,
    clocks,
    dependencies,
    derivatives,
    description,
    documents,
    events,
    exchange,
    experiment,
    imports,
    instances,
    logs,
    model_exchange,
    platforms,
    process,
    references,
    runs,
    sanitizer,
    semantics,
    sources,
    starts,
    states,
    structure,
    systems,
    terminals,
    ticks,
    typed_values,
    types,
    units,
    values,
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
    clocks.clocks,
    clocks.dimensions,
    terminals.terminals,
    semantics.semantics,
)
"""Checks of a valid model description. They are safe to run in one process."""

STATIC: tuple[Check, ...] = (
    archive.safe,
    archive.format_,
    archive.layout,
    description.readable,
    description.encoding,
    description.schema,
    *READING,
    binaries.present,
    platforms.platform,
    binaries.symbols,
    imports.imports,
    binaries.loads,
    platforms.version,
    builds.description,
    sources.compile_,
    documents.present,
)
"""Checks of the file alone. They run no code of the FMU, except what its library does when it is loaded."""

DYNAMIC: tuple[Check, ...] = (
    instances.created,
    instances.guid,
    runs.completes,
    runs.finite,
    runs.ranges,
    runs.deterministic,
    values.starts,
    values.kept,
    typed_values.booleans,
    typed_values.enumerations,
    typed_values.strings,
    instances.cycles,
    instances.independent,
    instances.threads,
    instances.reset,
    values.reset,
    values.shared,
    calls.phases,
    calls.nonfinite,
    calls.arguments,
    states.restored,
    states.serialized,
    states.freed,
    values.state,
    derivatives.directional,
    derivatives.adjoint,
    derivatives.of_outputs,
    dependencies.observed,
    dependencies.elements,
    exchange.order,
    behavior.inputs,
    behavior.interpolation,
    exchange.split,
    behavior.integrate,
    events.events,
    ticks.intervals,
    ticks.ticks,
    model_exchange.runs,
    model_exchange.agrees,
    logs.categories,
    process.resources,
    process.settings,
    process.files,
    process.output,
    process.unload,
    sanitizer.address,
    sanitizer.leaks,
    sanitizer.undefined,
)
"""Checks that call the FMU."""

CHECKS: tuple[Check, ...] = (*STATIC, *DYNAMIC, references.agrees)

VITAL = frozenset(
    {"archive.safe", "description.readable", "binaries.loads", "instance.created", "run.completes"}
)
"""Checks whose failure leaves nothing to run for those that need them."""

RECORDED = references.recorded
"""Runs instead of `CHECKS` to record references."""

SYSTEM = (systems.runs, systems.agrees)
"""Checks of a whole system. The second one needs a reference run."""

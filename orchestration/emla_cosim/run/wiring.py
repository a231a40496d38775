"""Wire a run: connect the plan, the network of FMUs, the recorders and the checkpoints."""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..base.units import IDENTITY
from ..inputs.loaded_input import input_events, row_distance
from ..master.assembly import Assembly
from ..master.stepping.checkpoint import Checkpoint, prepare_checkpoint
from ..master.stepping.profiler import Profiler
from ..master.stepping.step_size_control import StepRequest
from ..master.stepping.stepping_base import Stepping
from ..recorders.bond_energies import COUPLING, BondEnergies, make_bond_energies
from ..recorders.checkpoints import Checkpoints, find_resumable_checkpoint
from ..recorders.metrics import SIGNALS, Figures, MetricsRecorder, list_figures
from ..recorders.recorder import Recorder, RunLayout
from ..recorders.table import Table, TimeSeries
from ..system.model import System
from .agreement import find_common_signals
from .coupling_summary import CouplingSummary
from .execution import ActiveRun, close_stepping
from .remarks import choose_fallback_signals
from .requirements import Requirement, StopCondition, resolve_requirements
from .result import run_figures
from .run_record import RunDefinition
from .run_setup import RunPlan


def wire_run(
    plan: RunPlan, system: System, assembly: Assembly, recorders: Sequence[Recorder] | None, folder: Path
) -> ActiveRun:
    """Return a run before its initialization.

    Args:
        plan: What follows from the options.
        system: The system with its start values.
        assembly: The network of FMUs, which have these start values.
        recorders: The user's recorders; None for a table in memory.
        folder: The folder that paths of checkpoints are relative to.

    Raises:
        CommandError: An option does not fit the system.
    """
    options, unconnected_variables, fallback = plan.options, assembly.unconnected_variables, None
    if not plan.recorded:
        recorded, fallback = choose_fallback_signals(unconnected_variables.values())
        plan = replace(plan, recorded=recorded)
    observed = dict.fromkeys([*assembly.outputs, *plan.recorded, *(c.figure for c in plan.conditions)])
    # the network has exchanged variables and outputs; others are read in addition
    assembly.observe([name for name in observed if name in unconnected_variables], plan.steps_per_row)
    with contextlib.ExitStack() as on_error:
        profiler = None
        if options.profile:
            profiler = Profiler(assembly.network.instances)
            on_error.callback(profiler.close)
        stepping = _make_stepping(plan, system, assembly)
        on_error.callback(close_stepping, stepping)
        energies = _make_energies(plan, system, assembly)
        # run.json names the bonds that patterns have selected
        options = replace(options, bonds={name: str(bond) for name, bond in energies.bonds.items()})
        plan = replace(plan, options=options)
        fmus = {name: file.sha256 for name, file in assembly.files.items()}
        definition = RunDefinition(system, fmus, options)
        metrics = MetricsRecorder()
        all_recorders = [metrics, *([TimeSeries()] if recorders is None else _check_recorders(recorders))]
        all_recorders += [*([energies] if energies.bonds else []), *options.make_recorders()]
        checkpoints, resumed = _open_checkpoints(plan, definition, assembly, folder)
        all_recorders += checkpoints
        if plan.stored is not None:
            find_common_signals(plan.recorded, plan.stored)
            if not any(isinstance(recorder, Table) for recorder in all_recorders):
                raise CommandError(
                    "the option 'reference' needs a recorder that keeps a table, such as TimeSeries."
                )
        coupling = CouplingSummary.of(
            stepping.algorithm, stepping, assembly.sampling, options.estimate_coupling
        )
        layout = _make_layout(plan, assembly, stepping)
        requirements = _resolve_requirements(plan, layout, coupling, energies, system.main_name)
        plan = replace(plan, requirements=requirements)
        position = {name: i for i, name in enumerate(layout.names)}
        run = ActiveRun(
            plan,
            definition,
            [
                # the first number of a row is the time
                StopCondition(c, 1 + (i := position[c.figure]), assembly.transformations.get(i, IDENTITY))
                for c in plan.conditions
            ],
            fallback,
            stepping,
            coupling,
            layout,
            assembly.transformations,
            metrics,
            energies,
            all_recorders,
            resumed,
            profiler,
        )
        on_error.pop_all()
    return run


def _make_stepping(plan: RunPlan, system: System, assembly: Assembly) -> Stepping:
    """Set up the algorithm, and return what does its steps."""
    options, times = plan.options, plan.times
    plan.algorithm.setup(assembly.network)
    request = StepRequest(
        times,
        options.output_interval,
        any(component.samples for component in system.components),
        options.threads,
        lambda: input_events(options.input, options.fault, assembly.parameters(), times.start, times.stop),
        lambda: row_distance(options.input),
    )
    return plan.control.make_stepping(plan.algorithm, request)


def _make_energies(plan: RunPlan, system: System, assembly: Assembly) -> BondEnergies:
    """Return what sums up the energies of the bonds that the run needs, maybe of none."""
    names = [*assembly.network.names, *assembly.network.observer.names]
    units = {name: assembly.names.find(name).unit for name in names}
    required = [requirement.figure for requirement in plan.requirements]
    energies = make_bond_energies(
        plan.options.bonds, required, system, units, plan.algorithm, plan.control.is_halved
    )
    if energies.bonds and not plan.control.is_regular and plan.options.output_interval is not None:
        raise CommandError(
            "the energies of power bonds need each step, but with --error-tolerance, "
            "--output-interval leaves out steps; remove --output-interval or --bond."
        )
    return energies


def _open_checkpoints(
    plan: RunPlan, definition: RunDefinition, assembly: Assembly, folder: Path
) -> tuple[list[Recorder], Checkpoint | None]:
    """Return the recorder of checkpoints if there is one, and the checkpoint to continue from."""
    options = plan.options
    if options.resume is None and options.checkpoint is None:
        return [], None
    identity = definition.checkpoint_identity
    resumed = None
    if options.resume is not None:
        resumed = find_resumable_checkpoint(options.resume, identity, plan.times, folder)
    if options.checkpoint is None:
        return [], resumed
    file = prepare_checkpoint(options.checkpoint, assembly.network, folder, options.overwrite)
    return [Checkpoints(file, identity)], resumed


def _make_layout(plan: RunPlan, assembly: Assembly, stepping: Stepping) -> RunLayout:
    """Return what recorders must know of the rows, the system and the steps."""
    options, network, algorithm = plan.options, assembly.network, stepping.algorithm
    names = [*network.names, *network.observer.names]
    position = {name: i for i, name in enumerate(names)}
    signals = [assembly.names.find(name) for name in names]
    pairs = zip(network.instances, algorithm.multiples, strict=True)
    types = {name: signal.column_type for name, signal in zip(names, signals, strict=True)}
    return RunLayout(
        names,
        [signal.unit for signal in signals],
        plan.times,
        [position[name] for name in plan.recorded],
        plan.steps_per_row,
        assembly.parameters(),
        options.roles,
        options.criteria,
        multiples={x.name: int(n) for x, n in pairs if n > 1},
        types={
            n: t for n, t in types.items() if t.is_discrete and position[n] not in assembly.transformations
        },
        texts=network.observer.texts,
        notes=stepping.notes(),
    )


def _resolve_requirements(
    plan: RunPlan, layout: RunLayout, coupling: CouplingSummary, energies: BondEnergies, main: str
) -> Sequence[Requirement]:
    """Return the requirements with full names. Raise CommandError for figures that do not exist."""
    if not plan.requirements:
        return ()
    # one of its own, because that of the run begins with the run
    recorder = MetricsRecorder()
    recorder.begin(layout)
    kinds: dict[str, Figures] = {**recorder.figures(), SIGNALS: recorder.signals()}
    if figures := {**coupling.figures(None), **energies.figures()}:
        kinds[COUPLING] = figures
    is_complete = all(kinds.values())
    kinds["run"] = {"run": run_figures()}
    return resolve_requirements(plan.requirements, list_figures(kinds), is_complete, main)


def _check_recorders(recorders: Any) -> list[Recorder]:
    """Return the recorders as a list. Raise CommandError for other objects and duplicates."""
    if isinstance(recorders, Recorder) or not isinstance(recorders, Iterable):
        raise CommandError(f"the recorders are {recorders!r}; they must be a list.")
    checked = list(recorders)
    if wrong := [r for r in checked if not isinstance(r, Recorder)]:
        raise CommandError(f"{wrong[0]!r} is not a Recorder.")
    if len({id(r) for r in checked}) < len(checked):
        raise CommandError("the list of recorders has a recorder twice.")
    return checked

"""The plan of a comparison: its cases, all runs, and the independent subsystems that they use."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import Any

import networkx

from ...base.errors import CommandError, join_names
from ...base.progress import Progress
from ...base.toml_structs import read_toml
from ...run.choices import resolve
from ...run.run_setup import plan_run
from ...study.loading import load
from ...study.roles import find_joints
from ...system.fault import Fault
from ...system.model import System, Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..frame.session import Job
from ..variants.factors import find_start_values, format_arguments, merge_options, select_run_options
from .controller_variants import (
    CURRENT,
    VOLTAGE,
    ControllerVariant,
    HeldOutSeeds,
    Reserves,
    describe_reserves,
    find_equal_gains,
    find_reserve_values,
    list_observers,
    list_random_seeds,
)
from .result import LABELS


@dataclass(frozen=True)
class ComparisonCase:
    """A case of a comparison: start values to set and to scale, by pattern, and faults.

    Attributes:
        start_error: Distance in m between the screw and the start of its reference; None keeps that of the
            scenario.
        fault: Faults of signals, with * for the joint.
        at: The coordinates of a point on a map.
    """

    name: str = "nominal"
    set: Mapping[str, Value] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    start_error: float | None = None
    fault: Sequence[Mapping[str, Any]] = ()
    at: tuple[float, float] | None = None

    def faults(self, joints: Sequence[str]) -> list[Fault]:
        """Return the faults of this case for each of the joints."""
        return [
            Fault(**{**entry, "signal": entry["signal"].replace("*", joint, 1)})
            for joint in joints
            for entry in self.fault
        ]

    def resolve_start_values(self, prepared: Preparation) -> dict[str, Value] | None:
        """Return the start values of the case by full name; None if the system lacks a variable for it.

        All variables to set must exist, and at least one of those to scale.
        """
        fixed = [dict.fromkeys(_find_start_values(name, prepared), value) for name, value in self.set.items()]
        scaled = [_scale_values(pattern, factor, prepared) for pattern, factor in self.scale.items()]
        shifted = [] if self.start_error is None else [_shift_start(self.start_error, prepared)]
        # values to set must all exist; of those to scale, a joint may have some only
        if not all((*fixed, *shifted)) or (scaled and not any(scaled)):
            return None
        return {name: value for change in (*fixed, *scaled, *shifted) for name, value in change.items()}


@dataclass(frozen=True)
class MapAxis:
    """One axis of a map: the variables that it sets or scales, from `low` to `high`, in `unit`."""

    label: str
    low: float
    high: float
    set: Sequence[str] = ()
    scale: Sequence[str] = ()
    unit: float = 1.0

    def levels(self, count: int) -> list[float]:
        """Return the coordinates of this many points."""
        return [self.low + (self.high - self.low) * number / (count - 1) for number in range(count)]


@dataclass(frozen=True)
class StabilityMap:
    """A grid of cases over two axes."""

    name: str
    x: MapAxis
    y: MapAxis

    def cases(self, resolution: int) -> list[ComparisonCase]:
        """Return a case for each point, row by row."""
        return [
            ComparisonCase(
                f"{self.name}: {x:.4g}, {y:.4g}",
                {name: at * axis.unit for axis, at in ((self.x, x), (self.y, y)) for name in axis.set},
                {name: at * axis.unit for axis, at in ((self.x, x), (self.y, y)) for name in axis.scale},
                at=(x, y),
            )
            for y in self.y.levels(resolution)
            for x in self.x.levels(resolution)
        ]


def read_robustness_cases() -> list[ComparisonCase]:
    """Return the cases of the table `robustness`."""
    return [ComparisonCase(**entry) for entry in _read_cases_file("robustness")["case"]]


def read_stability_maps() -> list[StabilityMap]:
    """Return the maps of the table `stability`."""
    return [
        StabilityMap(m["name"], MapAxis(**m["x"]), MapAxis(**m["y"]))
        for m in _read_cases_file("stability")["map"]
    ]


def read_stability_stop_time() -> float:
    """Return the default stop time of the runs of maps, in s."""
    return float(_read_cases_file("stability")["stop_time"])


def _read_cases_file(name: str) -> dict[str, Any]:
    return read_toml((files("emla_cosim.study") / "cases" / f"{name}.toml").read_text(encoding="utf-8"), name)


def _find_start_values(pattern: str, prepared: Preparation) -> dict[str, float | None]:
    return find_start_values(pattern, prepared.system, prepared.interfaces)


def _scale_values(pattern: str, factor: float, prepared: Preparation) -> dict[str, Value]:
    """Return the values that match a pattern times the factor, limited to the bounds of each variable."""
    scaled, names = dict[str, Value](), Names(prepared.system, prepared.interfaces)
    for name, value in _find_start_values(pattern, prepared).items():
        if value is not None:
            declared = names.find(name).variable
            # an FMU may refuse a start value beyond its bounds
            low = -math.inf if declared.min is None else float(declared.min)
            high = math.inf if declared.max is None else float(declared.max)
            scaled[name] = min(max(factor * value, low), high)
    return scaled


def _shift_start(error: float, prepared: Preparation) -> dict[str, Value]:
    """Return start values that move plants and observers `error` in m away from their reference."""
    shifted = dict[str, Value]()
    for name, start in _find_start_values("*.reference.waypoint[1]", prepared).items():
        joint = name.removesuffix(".reference.waypoint[1]")
        for state in ("plant.start.x_L", "observer.start.x_hat"):
            if start is not None and _find_start_values(f"{joint}.{state}", prepared):
                shifted[f"{joint}.{state}"] = start + error
    return shifted


@dataclass(frozen=True)
class ComparisonRun:
    """One run: a controller in one case, in an independent subsystem with these joints.

    Attributes:
        changes: The options that make the case.
        group: The position of the prepared simulation.
        seed: The held-out seed of the random sequences; None for those of the scenario.
        is_random: Whether random sequences affect the run.
        observers: The observer of each joint as text.
        reserves: The reserves of the controllers as text.
    """

    scenario: str
    controller_variant: ControllerVariant
    case: ComparisonCase
    joints: Sequence[str]
    changes: Mapping[str, Any]
    group: int
    seed: int | None = None
    is_random: bool = False
    observers: Mapping[str, str] = field(default_factory=dict)
    reserves: str = ""

    def labels(self, joint: str) -> dict[str, str]:
        """Return the labels that distinguish the row of a joint from other rows, except for seeds."""
        variant = self.controller_variant
        return dict(
            zip(LABELS, (self.scenario, self.case.name, joint, variant.label, variant.gains), strict=True)
        )


@dataclass(frozen=True)
class ComparisonPlan:
    """All runs, in the order of the tables.

    Attributes:
        options: The options of all runs.
        notes: Remarks for the reader: what is left out, and the reserves of each controller.
    """

    runs: Sequence[ComparisonRun]
    groups: Sequence[Preparation]
    options: Mapping[str, Any]
    notes: Sequence[str]

    @property
    def jobs(self) -> list[Job]:
        """All runs for the workers."""
        return [Job(select_run_options(run.changes), run.group) for run in self.runs]

    def command(self, number: int) -> list[str] | None:
        """Return the command that repeats a run; None if an option is a Python object."""
        run = self.runs[number]
        controller = {"controller": run.controller_variant.controller, "gains": run.controller_variant.gains}
        arguments = format_arguments(merge_options([self.options, controller, run.changes]))
        return None if arguments is None else ["emla", "run", run.scenario, *arguments]


@dataclass(frozen=True)
class ComparisonTerms:
    """The terms that all runs share.

    Attributes:
        seeds: The number of held-out seeds for runs with random sequences; 0 for the seeds of the scenario.
        reserves: The reserves of all controllers; None keeps those of each controller.
        options: The options of all runs.
        skips_missing_gains: Whether joints without a set of gains are left out, with a note, as for `all`
            sets; otherwise they are an error.
    """

    seeds: int
    reserves: Reserves | None
    options: Mapping[str, Any]
    skips_missing_gains: bool = False


def plan_runs(
    scenarios: Sequence[str],
    variants: Sequence[ControllerVariant],
    cases: Sequence[ComparisonCase],
    terms: ComparisonTerms,
    progress: Progress,
) -> ComparisonPlan:
    """Build missing FMUs, and plan all runs.

    Raises:
        CommandError: A scenario or an option is wrong, or a scenario has no joints.
        RunError: An FMU cannot be built.
    """
    runs, groups, lacking = list[ComparisonRun](), list[Preparation](), list[str]()
    reserves, fixed = dict[str, dict[str, None]](), dict[str, None]()
    held_out = HeldOutSeeds(terms.seeds)
    for scenario in scenarios:
        for variant in variants:
            try:
                parts = list(_prepare_cases(scenario, variant, cases, terms, progress))
            except CommandError as error:
                if not (terms.skips_missing_gains and "gains" in error.fields and "joint" in error.fields):
                    raise
                joint = error.fields["joint"]
                lacking.append(f"{scenario} runs without {variant}: the joint {joint} has no such gains.")
                continue
            for part, case, changes in parts:
                if not groups or groups[-1] is not part:
                    groups.append(part)
                described = describe_reserves(part, changes["set"])
                reserves.setdefault(str(variant), {})[described] = None
                # a foreign controller may have no such parameters
                if terms.reserves is not None and not find_reserve_values(part, terms.reserves):
                    fixed[str(variant)] = None
                joints, sequences = find_joints(part.system), list_random_seeds(part, changes["set"])
                observers = list_observers(part, joints, changes["set"])
                names = [name for name in sequences if name not in (terms.options.get("set") or {})]
                for seed in (held_out.seeds if names else ()) or [None]:  # seeds of the user are kept
                    drawn = {} if seed is None else {"set": held_out.values(names, seed)}
                    options, group = merge_options([changes, drawn]), len(groups) - 1
                    position = scenario, variant, case, joints, options, group
                    runs.append(ComparisonRun(*position, seed, bool(sequences), observers, described))
    planned = {(run.scenario, run.case.name) for run in runs}
    notes = list[str]()
    for scenario in scenarios:
        if missing := [case.name for case in cases if (scenario, case.name) not in planned]:
            notes.append(f"Not run, as {scenario} has no such variables: {join_names(missing)}.")
    notes += lacking
    if not runs:
        raise CommandError(" ".join(["there is nothing to compare.", *notes]))
    notes += dict.fromkeys(
        f"Note: {note}." for group in groups if group.scenario for note in group.scenario.notes
    )
    texts = "; ".join(f"{name} {', '.join(each)}" for name, each in reserves.items())
    notes.append(f"Reserves of current and voltage: {texts}.")
    notes += [f"{name} keeps its own reserves: it has no {CURRENT} and {VOLTAGE} to set." for name in fixed]
    notes += _suggest_equal_observers(runs, terms.options)
    return ComparisonPlan(runs, groups, terms.options, notes)


def _suggest_equal_observers(runs: Sequence[ComparisonRun], options: Mapping[str, Any]) -> Iterator[str]:
    """Yield a remark for each scenario with unequal observers: sets of gains that have equal ones."""
    for scenario in dict.fromkeys(run.scenario for run in runs):
        of_scenario = [run for run in runs if run.scenario == scenario]
        controllers = list(dict.fromkeys(run.controller_variant.controller for run in of_scenario))
        pairs = {pair for run in of_scenario for pair in run.observers.items()}
        if len(controllers) < 2 or len(pairs) == len(dict(pairs)):
            continue
        if equal := find_equal_gains(scenario, controllers, options):
            yield f"Equal observers in {scenario}: --gains {shlex.quote(','.join(map(str, equal)))}."


def _prepare_cases(
    scenario: str,
    variant: ControllerVariant,
    cases: Sequence[ComparisonCase],
    terms: ComparisonTerms,
    progress: Progress,
) -> Iterator[tuple[Preparation, ComparisonCase, Mapping[str, Any]]]:
    """Yield the subsystems of a scenario, each with a case that it can run and the options of the case.

    Missing FMUs are built. Raises CommandError for a scenario without a joint.
    """

    def prepare(changes: Mapping[str, Any]) -> list[Preparation]:
        """Return the subsystems that have joints, with this controller."""
        controller_options: dict[str, Any] = {"controller": variant.controller, "gains": variant.gains}
        planned = load(scenario, **{**terms.options, **controller_options, **changes})
        plan_run(planned.options, planned.name)
        parts = find_independent_subsystems(Preparation.of(planned, progress))
        return [part for part in parts if find_joints(part.system)]

    nominal = prepare({})
    if not nominal:
        raise CommandError(
            f"'{scenario}' has no joint, a plant with its reference, to compare controllers on."
        )
    pairs: list[tuple[Preparation, ComparisonCase, dict[str, Any]]]
    pairs = [(part, case, {}) for part in nominal for case in cases if not case.fault]
    joints = [joint for part in nominal for joint in find_joints(part.system)]
    for case in cases:
        if case.fault:  # faults become part of the system before it is prepared
            changes = {"fault": [*terms.options.get("fault", ()), *case.faults(joints)]}
            pairs += [(part, case, changes) for part in prepare(changes)]
    for part, case, changes in pairs:
        if (values := case.resolve_start_values(part)) is not None:
            common = {} if terms.reserves is None else find_reserve_values(part, terms.reserves)
            yield part, case, {**changes, "set": {**values, **common}}


def find_independent_subsystems(prepared: Preparation) -> list[Preparation]:
    """Return one subsystem for each joint, or for each group of joints that connections link."""
    # joints that exchange signals must run together; all others end their runs alone
    graph = networkx.Graph()
    system = prepared.system
    branch = {c.name: c.branch for c in system.components}
    graph.add_nodes_from(branch.values())
    graph.add_edges_from((branch[x.source], branch[x.target]) for x in system.connections)
    groups = list(networkx.connected_components(graph))
    return [prepared] if len(groups) == 1 else [_make_subsystem(prepared, branches) for branches in groups]


def _make_subsystem(prepared: Preparation, branches: set[str]) -> Preparation:
    """Return what was prepared, reduced to the components of these branches."""
    system = prepared.system
    components = tuple(c for c in system.components if c.branch in branches)
    names = {c.name for c in components}
    removed = {c.name for c in system.components} - names
    bonds = {name: bond for name, bond in system.bonds.items() if system.split(bond.effort)[0].name in names}
    fmus = {name: sha for name, sha in prepared.fmus.items() if name in names}
    layers = [
        {name: _remove_components(value, removed) for name, value in layer.items()}
        for layer in prepared.options.resolution.layers
    ]
    return replace(
        prepared,
        system=System(components, tuple(x for x in system.connections if x.source in names), bonds),
        options=replace(prepared.options, resolution=resolve(layers)),
        fmus=fmus,
        interfaces={name: interface for name, interface in prepared.interfaces.items() if name in names},
        files={sha: path for sha, path in prepared.files.items() if sha in fmus.values()},
    )


def _remove_components(value: Any, components: set[str]) -> Any:
    """Return the value of an option without the components that it names."""
    if isinstance(value, Mapping):
        return {name: x for name, x in value.items() if name not in components}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [x for x in value if x not in components]
    return value

"""The plan of a sweep, and its variants with values, grouped by the prepared system that runs them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec
import polars
import psutil

from ...base.errors import CommandError
from ...base.files import hash_plain_data
from ...base.progress import Progress
from ...run.scenarios.scenario_file import PLANS
from ...system.model import Value
from ..execution.executor import WorkPackage
from ..execution.worker_payload import Preparation
from ..frame.plan_files import AnalysisPlan, Source, load_planned, read_plan
from ..variants.factors import Factor, merge_options, needs_preparation, resolve_factors, select_run_options
from ..variants.measures import VARIANT, Metric, Variant
from ..variants.sampling import SAMPLINGS, count_variants, sample


@dataclass(frozen=True)
class Plan(AnalysisPlan):
    """A sweep: a scenario, what varies, how it is sampled, and what is kept.

    Args:
        name: name of the sweep.
        scenario: what is run: a scenario, its name or its file, or a `System`.
        vary: what varies, and how, as for `sweep`.
        description: one line on its purpose.
        sampling: how variants are chosen, as for `sweep`.
        runs: number of variants to draw.
        seed: seed of all random draws.
        metrics: metrics to keep, as for `sweep`. Default: all.
        signals: names or patterns of signals to keep over time.
        options: values of options by name, for all variants.
        where: what error messages call the plan.

    Examples:
        >>> import emla_cosim as ec
        >>> plan = ec.Plan("warm", "lift", {"lift.plant.motor.R_s": "0.1:0.2"}, runs=8)
        >>> plan.updated({"runs": 16}).runs
        16
    """

    sampling: str | None = None
    runs: int | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    metrics: Sequence[Metric] | Mapping[str, Metric] = ()
    signals: Sequence[str] = ()
    where: str = field(default="the sweep", kw_only=True)

    NOTHING_VARIES = "varies nothing; add a factor, for example --vary lift.plant.motor.R_s=0.05:0.3:20"

    def updated(self, changes: Mapping[str, Any]) -> Self:
        """Return the plan with other values; `vary` and `options` are merged, None changes nothing.

        A sampling that does not take `runs` drops those of the plan.

        Args:
            changes: values of fields by name.

        Raises:
            CommandError: a value has a wrong type.
        """
        method = SAMPLINGS.get(str(changes.get("sampling")))
        return super(Plan, replace(self, runs=None) if method and method.own_size else self).updated(changes)


def load_plan(source: Source | Plan) -> Plan:
    """Load a plan by name, from a .toml file with `vary`, or from a scenario, which varies nothing.

    Raises:
        CommandError: The file cannot be read or is not a plan.
    """
    if isinstance(source, Plan):
        return source
    values, folder = read_plan(source, Plan, "sweep", "plan", PLANS)
    if folder is not None:
        values["vary"] = {name: _resolve_files(folder, entry) for name, entry in values["vary"].items()}
    plan = Plan(**values)
    if "vary" in values:
        plan.check()
    return plan


def _resolve_files(folder: Path, entry: Any) -> Any:
    """Return the values of a factor with files relative to the folder of the plan."""
    match entry:
        case str() if entry.lower().endswith((".fmu", ".ssv", ".toml")) and "," not in entry:
            return str(folder / entry)
        case {"values": values}:
            return {**entry, "values": _resolve_files(folder, values)}
        case list():
            return [_resolve_files(folder, value) for value in entry]
    return entry


_BYTES_PER_VALUE = 64
"""Memory of a value as an object and in a table."""


@dataclass(frozen=True)
class VariantGroup:
    """Variants that one prepared simulation can run, and their factors."""

    preparation: Preparation
    factors: Sequence[Factor]


@dataclass(frozen=True)
class Design:
    """All variants of a plan.

    `factor_values` has the values of each factor, `group_of` the position in `groups` for each variant.
    """

    plan: Plan
    method: str
    groups: Sequence[VariantGroup]
    factor_values: Sequence[Sequence[Value | None]]
    group_of: Sequence[int]

    @property
    def count(self) -> int:
        """The number of variants."""
        return len(self.group_of)

    @property
    def factors(self) -> Sequence[Factor]:
        """The factors."""
        return self.groups[0].factors

    def _list_factor_values(self, number: int) -> list[tuple[Factor, Value | None]]:
        """Return the factors of a variant with their values in the table."""
        factors = self.groups[self.group_of[number]].factors
        return [(f, f.value(values[number])) for f, values in zip(factors, self.factor_values, strict=True)]

    def options(self, number: int) -> dict[str, Any]:
        """Return the options that are specific to a variant."""
        return merge_options(factor.options(value) for factor, value in self._list_factor_values(number))

    def variant(self, number: int) -> Variant:
        """Return a variant with the options that a prepared simulation accepts."""
        return Variant(number, select_run_options(self.options(number)))

    def work(self, finished: set[int]) -> list[WorkPackage]:
        """Return the variants that are not finished, by group."""
        remaining: list[list[int]] = [[] for _ in self.groups]
        for number, group in enumerate(self.group_of):
            if number not in finished:
                remaining[group].append(number)
        return [WorkPackage(group, numbers) for group, numbers in enumerate(remaining) if numbers]

    def table(self) -> polars.DataFrame:
        """Return a table with the number and values of every variant."""
        rows = [self._list_factor_values(number) for number in range(self.count)]
        columns = [_make_column(f.name, [row[i][1] for row in rows]) for i, f in enumerate(self.factors)]
        return polars.DataFrame([polars.Series(VARIANT, range(self.count), polars.Int64), *columns])

    @cached_property
    def identities(self) -> list[dict[str, Any]]:
        """The definition of each group, as plain data."""
        return [group.preparation.identity for group in self.groups]

    def identity(self, metrics: object) -> dict[str, Any]:
        """Return what must be unchanged to resume a sweep, by its name in messages."""
        content = [
            (factor.name, [asdict(target) for target in factor.targets], [str(v) for v in column])
            for factor, column in zip(self.factors, self.factor_values, strict=True)
        ]
        return {
            "values": hash_plain_data(content),
            "seed": self.plan.seed,
            "sampling": self.method,
            "FMUs or settings": hash_plain_data(self.identities),
            "metrics": hash_plain_data(metrics),
        }

    def provenance(self, metrics: object) -> list[str]:
        """Return for each variant a hash of everything that determines its result."""
        parts = [hash_plain_data((identity, metrics)) for identity in self.identities]
        return [hash_plain_data((parts[self.group_of[n]], self.options(n))) for n in range(self.count)]


def design_variants(plan: Plan, progress: Progress) -> Design:
    """Turn a plan into variants: build FMUs, resolve names, draw values.

    Raises:
        CommandError: The plan is invalid.
        RunError: An FMU cannot be built.
    """
    plan.check()
    first = Preparation.of(load_planned(plan), progress)
    factors = resolve_factors(plan.vary, first.system, first.interfaces, plan.where)
    method = plan.sampling or ("grid" if plan.runs is None else "random")
    _check_size(plan, method, factors)  # before the values are drawn, which would fill the memory
    columns = sample(method, [f.distribution for f in factors], plan.runs, plan.seed)
    prepared = [i for i, f in enumerate(factors) if any(needs_preparation(target) for target in f.targets)]
    keys: dict[str, int] = {}
    groups, group_of = list[VariantGroup](), list[int]()
    for row in zip(*(columns[i] for i in prepared), strict=True) if prepared else [()] * len(columns[0]):
        options = merge_options(factors[i].options(value) for i, value in zip(prepared, row, strict=True))
        # a preparation may build FMUs: variants with the same options of that kind share one
        key = json.dumps(options, sort_keys=True, default=str)
        if key not in keys:
            keys[key] = len(groups)
            groups.append(_prepare_group(plan, options, first if not options else None, factors, progress))
        group_of.append(keys[key])
    return Design(plan, method, groups, columns, group_of)


def _prepare_group(
    plan: Plan,
    options: Mapping[str, Any],
    first: Preparation | None,
    expected: Sequence[Factor],
    progress: Progress,
) -> VariantGroup:
    """Prepare the system with these options. Its factors must be the same as without them (`expected`)."""
    preparation = first or Preparation.of(load_planned(plan, options), progress)
    factors = resolve_factors(plan.vary, preparation.system, preparation.interfaces, plan.where)
    problem = ""
    if [f.name for f in factors] != [f.name for f in expected]:
        problem = "varies different start values"
    elif any(f.targets != u.targets for f, u in zip(factors, expected, strict=True) if len(f.targets) > 1):
        problem = "multiplies different values"
    if problem:
        text = ", ".join(f"{name} = {value}" for name, value in options.items())
        raise CommandError(f"{plan.where} {problem} with {text} than without.")
    return VariantGroup(preparation, factors)


def _check_size(plan: Plan, method: str, factors: Sequence[Factor]) -> None:
    """Raise CommandError if the variants cannot be sampled, or do not fit into the memory."""
    try:
        variants = count_variants(method, [f.distribution for f in factors], plan.runs)
    except CommandError as error:
        if "index" in error.fields:
            name = factors[error.fields["index"]].name
            raise CommandError(f"'{name}' of {plan.where}: {error}", name=name) from error
        raise CommandError(f"{plan.where}: {error}", **error.fields) from error
    available = psutil.virtual_memory().available
    if variants * (len(factors) + 8) * _BYTES_PER_VALUE > 0.5 * available:
        raise CommandError(
            f"{plan.where} has {variants} variants; {available / 2**30:.3g} GiB of memory are not enough; "
            "use fewer levels or runs.",
            variants=variants,
        )


def _make_column(name: str, values: Sequence[Value | None]) -> polars.Series:
    """Return values as a column of their type; values of several types as text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        kind: Any = polars.Int64 if kinds == {int} else polars.Float64
    elif kinds == {bool}:
        kind = polars.Boolean
    else:
        kind, values = polars.String, [None if v is None else str(v) for v in values]
    return polars.Series(name, values, kind, strict=False)

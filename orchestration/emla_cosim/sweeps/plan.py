"""The plan of a sweep: scenario, factors, sampling, and metrics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ..base.class_structs import check_fields, struct_of
from ..base.errors import CommandError
from ..base.files import read_text
from ..base.option import SWEEP
from ..base.toml_structs import Struct, describe, dotted, list_given, read_toml
from ..base.values import convert_value
from ..run.options import list_options
from ..run.scenarios.built_in import PLANS
from ..run.scenarios.option_fields import with_options
from ..run.scenarios.scenario import Scenario
from ..system.model import System
from .measures import Metric
from .sampling import SAMPLINGS
from .targets import merge_options

Source = str | Path | System | Scenario
"""A scenario, its name or its file."""

NOT_IN_FILES = ("name", "options", "where")
"""Fields of a plan that are not entries of its file."""

IN_FILES: Mapping[str, Any] = {
    "scenario": Annotated[str, describe("name or path of what is run", "study")],
    "vary": Annotated[
        dict[str, Any],
        dotted("what varies, and how, by name", lambda table: isinstance(table.get("distribution"), str)),
    ],
    "metrics": list[str] | dict[str, str],
}
"""Types of fields in files of plans that differ from those in Python."""


@dataclass(frozen=True)
class Plan:
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

    name: str
    scenario: Source
    vary: Mapping[str, Any]
    description: str = ""
    sampling: str | None = None
    runs: int | None = None
    seed: int = 0
    metrics: Sequence[Metric] | Mapping[str, Metric] = ()
    signals: Sequence[str] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    where: str = "the sweep"

    def updated(self, given: Mapping[str, Any]) -> "Plan":
        """Return the plan with other values; `vary` and `options` are merged, None changes nothing.

        A sampling that does not take `runs` drops those of the plan.

        Args:
            given: values of fields by name.

        Raises:
            CommandError: a value has a wrong type.
        """
        found = {name: value for name, value in given.items() if value is not None}
        if (method := SAMPLINGS.get(str(found.get("sampling")))) is not None and not method.takes_runs:
            found = {"runs": None, **found}
        for name in ("vary", "options"):
            if name in found and not isinstance(found[name], Mapping):
                raise CommandError(f"'{name}' of {self.where} is {found[name]!r}; it must be a table.")
        if "vary" in found:
            found["vary"] = {**self.vary, **found["vary"]}
        if "options" in found:
            found["options"] = merge_options([self.options, found["options"]])
        changed = replace(self, **found)
        changed.check()
        return changed

    def check(self) -> None:
        """Raise CommandError for mistakes that can be found without the scenario."""
        check_fields(self, SWEEP_PLAN, self.where, IN_FILES)
        if wrong := [
            name for name in self.options if name in list_options() and name not in list_options(SWEEP)
        ]:
            raise CommandError(f"the option {wrong[0]} is for a single run; remove it from {self.where}.")
        if not self.vary:
            raise CommandError(
                f"{self.where} varies nothing; add a factor, for example "
                "--vary lift.plant.motor.R_s=0.05:0.3:20."
            )


_SEED = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
SWEEP_PLAN = struct_of(Plan, {**IN_FILES, "seed": _SEED}, NOT_IN_FILES)
"""The struct of a plan's file, without options."""


def load_plan(source: Source | Plan) -> Plan:
    """Load a plan by name, from a .toml file with `vary`, or from a scenario, which varies nothing.

    Raises:
        CommandError: The file cannot be read or is not a plan.
    """
    if isinstance(source, Plan):
        return source
    if not isinstance(source, (str, Path)):
        return Plan(source.name if isinstance(source, Scenario) else "system", source, {})
    if str(source) in PLANS:
        label = f"the plan '{source}'"
        return _parse_plan(read_toml(PLANS[str(source)](), label), str(source), label, None)
    path = Path(source)
    if path.suffix.lower() == ".toml":
        content = read_plan_file(path)
        if content is not None:
            return _parse_plan(content, path.stem, f"the plan '{path}'", path.parent)
    name = path.stem if path.suffix else path.name
    return Plan(name, source, {}, where=f"the sweep of '{source}'")


def read_plan_file(path: Path) -> dict[str, Any] | None:
    """Return the content of a plan, which has `vary`; None for a scenario.

    Raises:
        CommandError: The file cannot be read, or is not TOML.
    """
    content = read_toml(read_text(path, "the plan"), f"the plan '{path}'")
    return content if "vary" in content else None


def plan_struct(table: type[Struct]) -> type[Struct]:
    """Return the struct of a plan: its fields, and the options of a sweep."""
    return with_options(table, table.__name__, SWEEP)


def read_plan(
    content: Mapping[str, Any], table: type[msgspec.Struct], label: str, folder: Path | None
) -> dict[str, Any]:
    """Read the content of a plan.

    Args:
        content: The content.
        table: The fields of the plan, without options.
        label: What error messages call the plan.
        folder: The folder of relative paths, also of the scenario.

    Returns:
        The fields that the file has by name, `options` and `where`.

    Raises:
        CommandError: An entry is unknown, missing or wrong.
    """
    values = list_given(convert_value(content, plan_struct(table), label, folder))
    options = {name: values.pop(name) for name in [*values] if name not in table.__struct_fields__}
    if folder is not None and (folder / values["scenario"]).exists():
        values["scenario"] = str(folder / values["scenario"])
    return {**values, "options": options, "where": label}


def _parse_plan(content: Mapping[str, Any], name: str, label: str, folder: Path | None) -> Plan:
    """Return the plan of a content. Paths in it are relative to `folder`."""
    values = read_plan(content, SWEEP_PLAN, label, folder)
    values["vary"] = {varied: _with_files_of(folder, given) for varied, given in values["vary"].items()}
    plan = Plan(name, **values)
    plan.check()
    return plan


def _with_files_of(folder: Path | None, given: Any) -> Any:
    """Return the values of a factor with files relative to the folder of the plan."""
    if folder is None:
        return given
    if isinstance(given, str):
        return (
            str(folder / given)
            if given.lower().endswith((".fmu", ".ssv", ".toml")) and "," not in given
            else given
        )
    if isinstance(given, Mapping):
        return {
            key: _with_files_of(folder, value) if key == "values" else value for key, value in given.items()
        }
    return [_with_files_of(folder, one) for one in given] if isinstance(given, list) else given

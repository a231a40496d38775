"""The plan of a sweep: scenario, factors, sampling, and metrics."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..base.files import read_text
from ..base.option import SWEEP
from ..base.values import convert_value
from ..run.options import list_options, read_option
from ..run.scenarios.built_in import PLANS
from ..run.scenarios.scenario import Scenario
from ..run.scenarios.scenario_file import read_given_options
from ..system.model import System
from .measures import Metric
from .sampling import SAMPLINGS
from .targets import merge_options

Source = str | Path | System | Scenario
"""A scenario, its name or its file."""

_OWN = ("scenario", "description", "vary", "sampling", "runs", "seed", "metrics", "signals")
_LARGEST_SEED = 2**63 - 1


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
        types = {"runs": int | None, "seed": int, "sampling": str | None, "signals": Sequence[str]}
        for name, type_ in types.items():
            convert_value(getattr(self, name), type_, f"'{name}' of {self.where}")
        if wrong := [
            name for name in self.options if name in list_options() and name not in list_options(SWEEP)
        ]:
            raise CommandError(f"the option {wrong[0]} is for a single run; remove it from {self.where}.")
        if not 0 <= self.seed <= _LARGEST_SEED:
            raise CommandError(f"the seed {self.seed} of {self.where} must be from 0 to {_LARGEST_SEED}.")
        if not self.vary:
            raise CommandError(
                f"{self.where} varies nothing; add a factor, for example "
                "--vary lift.plant.motor.R_s=0.05:0.3:20."
            )


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
        content = tomllib.loads(PLANS[str(source)]())
        return _parse_plan(content, str(source), f"the plan '{source}'", None)
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
    try:
        content = tomllib.loads(read_text(path, "the plan"))
    except (ValueError, RecursionError) as error:  # also for huge numbers and deep nesting
        raise CommandError(f"the plan '{path}' is not TOML: {error}.") from error
    return content if "vary" in content else None


def find_plan_scenario(content: Mapping[str, Any], label: str, folder: Path | None) -> str:
    """Return the scenario of a plan, whose path may be relative to `folder`. Raises CommandError."""
    if "scenario" not in content:
        raise CommandError(f'{label} has no scenario; add scenario = "study", or the path of a scenario.')
    scenario = convert_value(content["scenario"], str, f"'scenario' of {label}")
    if folder is not None and (folder / scenario).exists():
        return str(folder / scenario)
    return scenario


def _parse_plan(content: Mapping[str, Any], name: str, label: str, folder: Path | None) -> Plan:
    """Return the plan of a content. Paths in it are relative to `folder`."""
    scenario = find_plan_scenario(content, label, folder)
    options = {
        option: read_option(option, value, f"'{option}' of {label}", folder)
        for option, value in read_given_options(content, label, _OWN, SWEEP).items()
    }
    plan = Plan(
        name,
        scenario,
        {
            varied: _with_files_of(folder, given)
            for varied, given in flatten(
                convert_value(content["vary"], Mapping[str, Any], f"'vary' of {label}")
            )
        },
        description=convert_value(content.get("description", ""), str, f"'description' of {label}"),
        metrics=content.get("metrics", ()),
        signals=convert_value(content.get("signals", []), Sequence[str], f"'signals' of {label}"),
        options=options,
        where=label,
    )
    return plan.updated({key: content[key] for key in ("sampling", "runs", "seed") if key in content})


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


def flatten(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield entries by their full name: TOML nests names with dots unless they are quoted."""
    for key, value in table.items():
        if isinstance(value, dict) and not isinstance(value.get("distribution"), str):
            yield from ((f"{key}.{name}", inner) for name, inner in flatten(value))
        else:
            yield key, value

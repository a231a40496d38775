"""Information on a system."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.errors import CommandError, suggest_names
from ..base.output_files import OutputFile, has_format
from ..base.patterns import is_pattern, matches_pattern
from ..views.pages.plain import to_plain
from .info_parts import ComponentInfo, ConnectionInfo, FmuInfo, VariableInfo

if TYPE_CHECKING:
    import polars

FORMAT = "emla-info"
VERSION = 1
"""Version of the JSON format."""

JSON_FILE = "the JSON file"
"""Name of the file in error messages."""

is_info = has_format(FORMAT)
"""Recognizes files that `Info.save_json` wrote."""


@dataclass(frozen=True)
class Info:
    """Content of an FMU, an SSP or a scenario. `info["lift.plant.x_L"]` is one of its variables.

    Attributes:
        name: name of the scenario, or of the file.
        description: one line on its purpose.
        start_time: in s; None if none is defined.
        stop_time: in s; None if none is defined.
        step_size: in s; None if none is defined.
        notes: notes and warnings.
        fmus: FMU files, each once.
        components: components of the system.
        connections: connections between them.
        variables: variables of all components.
    """

    name: str
    description: str
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    notes: tuple[str, ...]
    fmus: tuple[FmuInfo, ...]
    components: tuple[ComponentInfo, ...]
    connections: tuple[ConnectionInfo, ...]
    variables: tuple[VariableInfo, ...]

    def __getitem__(self, name: str) -> VariableInfo:
        """Return the variable of this full name; raise CommandError if it does not exist."""
        found = self._by_name.get(name)
        if found is None:
            meant = suggest_names(name, self._by_name)
            raise CommandError(f"{self.name} has no variable '{name}'; {meant}", name=name)
        return found

    @cached_property
    def _by_name(self) -> dict[str, VariableInfo]:
        return {v.name: v for v in self.variables}

    def matching(self, *patterns: str) -> "Info":
        """Return the same with the matching variables only.

        Args:
            *patterns: a pattern with `*` or `?` matches full names and names inside of a component. A word
                without them is searched in full names and descriptions, in upper or lower case.

        Raises:
            CommandError: a pattern matches no variable.

        Examples:
            >>> import emla_cosim as ec
            >>> [v.name for v in ec.info("lift").matching("*.plant.x_L").variables]
            ['lift.plant.x_L']
        """
        kept: set[str] = set()
        for pattern in patterns:
            found = {v.name for v in self.variables if _is_match(v, pattern)}
            if not found:
                raise CommandError(
                    f"no variable of {self.name} matches '{pattern}'; write a pattern such as '*.x_L', or "
                    "a word of a name or a description.",
                    pattern=pattern,
                )
            kept |= found
        return replace(self, variables=tuple(v for v in self.variables if v.name in kept))

    def to_polars(self) -> "polars.DataFrame":
        """Return the variables as a polars data frame; start values are text."""
        import polars

        columns: dict[str, Sequence[Any]] = {
            name: [getattr(v, name) for v in self.variables] for name in VariableInfo.__dataclass_fields__
        }
        for name in ("start", "default"):
            columns[name] = [None if x is None else format_start(x) for x in columns[name]]
        for name in ("choices", "read_by"):
            columns[name] = [list(x) for x in columns[name]]
        return polars.DataFrame(columns, schema_overrides=_schema())

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data; numbers that are not finite become None."""
        return {**self._head(), "variables": [_plain_row(v) for v in self.variables]}

    def as_json(self) -> str:
        """Return everything as JSON text, with one line for each variable."""
        head = json.dumps(self._head(), indent=1, allow_nan=False).removesuffix("\n}")
        rows = (json.dumps(_plain_row(v), allow_nan=False) for v in self.variables)
        return f'{head},\n "variables": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"

    def _head(self) -> dict[str, Any]:
        """Return everything except the variables."""
        told = asdict(replace(self, variables=()))
        del told["variables"]
        return to_plain({"format": FORMAT, "version": VERSION, **told})

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write everything to a JSON file.

        Args:
            path: path of the file.
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file must not be written.
            RunError: writing fails.
        """
        file = OutputFile(Path(path), JSON_FILE, is_info, overwrite)
        file.write(self.as_json().encode("utf-8", "replace"))


def format_start(value: float | int | bool | str) -> str:
    """Format a start value for `--set`: 0.14, 8, true, or a name, with all digits."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _plain_row(variable: VariableInfo) -> dict[str, Any]:
    """Convert a variable for JSON. Only its start values can be infinite or NaN."""
    start, default = to_plain(variable.start), to_plain(variable.default)
    lists = {"choices": list(variable.choices), "read_by": list(variable.read_by)}
    return {**vars(variable), **lists, "start": start, "default": default}


def _is_match(variable: VariableInfo, pattern: str) -> bool:
    inside = variable.name.removeprefix(f"{variable.component}.")
    if matches_pattern(variable.name, pattern) or matches_pattern(inside, pattern):
        return True
    word = pattern.casefold()
    return not is_pattern(pattern) and word in f"{variable.name}\n{variable.description}".casefold()


def _schema() -> dict[str, Any]:
    """Return the types of columns that may be empty."""
    import polars

    numbers = dict.fromkeys(("minimum", "maximum"), polars.Float64)
    texts = dict.fromkeys(("start", "default", "unit", "driven_by"), polars.String)
    return {**numbers, **texts, **dict.fromkeys(("choices", "read_by"), polars.List(polars.String))}

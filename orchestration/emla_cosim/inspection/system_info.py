"""Information on a system."""

import difflib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.errors import CommandError
from ..base.ownership import has_format
from ..base.patterns import is_pattern, matches_pattern
from ..views.pages.plain import to_plain
from ..views.pages.text_file import write_text
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
    """Information on an FMU, a package or a scenario. Times are in s, or None if unknown.

    `fmus` has each file once, even if several components use it. `notes` are remarks without full stops.
    `info["lift.plant.x_L"]` is one of its variables.
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
        """Return the variable of this full name. Raise CommandError with suggestions for an unknown name."""
        found = self._by_name.get(name)
        if found is None:
            near = difflib.get_close_matches(name, self._by_name, n=3, cutoff=0.5)
            meant = f"; did you mean {' or '.join(near)}?" if near else "."
            raise CommandError(f"{self.name} has no variable '{name}'{meant}", name=name, near=near)
        return found

    @cached_property
    def _by_name(self) -> dict[str, VariableInfo]:
        return {v.name: v for v in self.variables}

    def matching(self, *patterns: str) -> "Info":
        """Return the same information with only the variables that match one of the patterns.

        A pattern with `*` or `?` matches full names, or names within a component. Other words are searched
        in full names and descriptions, ignoring case.

        Raises:
            CommandError: If a pattern has no match.
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
        """Return the variables as a polars data frame. Start values are texts, because their types differ."""
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
        """Return the content as for JSON; infinite numbers and NaN are None."""
        return {**self._head(), "variables": [_plain_row(v) for v in self.variables]}

    def as_json(self) -> str:
        """Return `as_dict` as JSON text, a line for each variable, without control characters."""
        head = json.dumps(self._head(), indent=1, allow_nan=False).removesuffix("\n}")
        rows = (json.dumps(_plain_row(v), allow_nan=False) for v in self.variables)
        return f'{head},\n "variables": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"

    def _head(self) -> dict[str, Any]:
        """Return everything except the variables."""
        told = asdict(replace(self, variables=()))
        del told["variables"]
        return to_plain({"format": FORMAT, "version": VERSION, **told})

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write `as_json` to a file.

        Args:
            path: The file.
            overwrite: Whether to replace a file that emla did not write.

        Raises:
            CommandError: If no file can be written there.
            RunError: If writing fails.
        """
        write_text(self.as_json(), Path(path), JSON_FILE, is_info, overwrite)


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

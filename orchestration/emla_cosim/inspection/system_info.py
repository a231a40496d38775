"""All that is told of a system."""

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
"""Of what the fields mean."""

JSON_FILE = "the JSON file"
"""What error messages call the file."""

is_info = has_format(FORMAT)
"""Recognizes files that `Info.save_json` wrote."""


@dataclass(frozen=True)
class Info:
    """What an FMU, a package or a scenario is made of; times in s, None where nobody says them.

    `fmus` are files, each once however many components are made of it. `notes` are sentences on what
    is worth knowing. `info["lift.plant.x_L"]` is one of its variables.
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
        """The variable of this full name; CommandError suggests what may have been meant."""
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
        """The same with those variables only that one of the patterns finds.

        A pattern with `*` or `?` is that of a full name, or of a name inside of a component; a word without
        is looked for in full names and descriptions, whether in capitals or not. Raises CommandError for
        a pattern that finds nothing.
        """
        kept: set[str] = set()
        for pattern in patterns:
            found = {v.name for v in self.variables if _is_match(v, pattern)}
            if not found:
                raise CommandError(
                    f"no variable of {self.name} fits '{pattern}'; write a pattern such as '*.x_L', or a "
                    "word of a name or a description.",
                    pattern=pattern,
                )
            kept |= found
        return replace(self, variables=tuple(v for v in self.variables if v.name in kept))

    def to_polars(self) -> "polars.DataFrame":
        """The variables as a polars data frame; start values are texts, since their types differ."""
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
        """All of it as JSON has it; a number that is infinite or not a number is None."""
        return {**self._head(), "variables": [_plain_row(v) for v in self.variables]}

    def as_json(self) -> str:
        """The text of `as_dict`, a line for each variable, in letters that no terminal obeys."""
        head = json.dumps(self._head(), indent=1, allow_nan=False).removesuffix("\n}")
        rows = (json.dumps(_plain_row(v), allow_nan=False) for v in self.variables)
        return f'{head},\n "variables": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"

    def _head(self) -> dict[str, Any]:
        """All but the variables."""
        told = asdict(replace(self, variables=()))
        del told["variables"]
        return to_plain({"format": FORMAT, "version": VERSION, **told})

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write `as_json` to a file; CommandError where none can be written, RunError where that fails.

        A file of something else is only replaced with `overwrite`.
        """
        write_text(self.as_json(), Path(path), JSON_FILE, is_info, overwrite)


def format_start(value: float | int | bool | str) -> str:
    """A start value as `--set` takes it: 0.14, 8, true, or a name, with all digits."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _plain_row(variable: VariableInfo) -> dict[str, Any]:
    """A variable as JSON has it: of its fields only start values may be no finite numbers."""
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
    """The types of columns that may have nothing in them."""
    import polars

    numbers = dict.fromkeys(("minimum", "maximum"), polars.Float64)
    texts = dict.fromkeys(("start", "default", "unit", "driven_by"), polars.String)
    return {**numbers, **texts, **dict.fromkeys(("choices", "read_by"), polars.List(polars.String))}

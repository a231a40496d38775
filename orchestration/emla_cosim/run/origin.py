"""Where a run comes from: the scenario as it was named, and what was given beside it."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from ..base.files import get_working_folder
from .options import list_options, merge


@dataclass(frozen=True)
class RunOrigin:
    """The scenario that was named, and the options that were given beside it, typed, by name.

    `source` is a name, or the absolute path of a file; None of a system made in Python. `sha256` is the
    hash of that file as it was read, None where it is no file. Paths among the options are absolute.
    """

    source: str | None = None
    sha256: str | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def updated(self, given: Mapping[str, Any]) -> "RunOrigin":
        """Return the origin with further options, which `read_options` returned, merged as `merge` does."""
        if not given:
            return self
        both = merge(self.overrides, with_gains(given))
        names = [name for name in list_options() if name in self.overrides or name in given]
        return replace(self, overrides={name: _make_absolute(name, both[name]) for name in names})


def read_origin(path: Path, content: bytes | None) -> RunOrigin:
    """The origin that a file with this content is; None of a folder."""
    digest = None if content is None else hashlib.sha256(content).hexdigest()
    return RunOrigin(str(get_working_folder() / path), digest)


def with_gains(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return options in which a controller without gains gets its recommended ones, not those of another."""
    return {"gains": None, **given} if given.get("controller") is not None else given


def _make_absolute(name: str, value: Any) -> Any:
    """A value whose paths lead to the same files from anywhere."""
    if isinstance(value, Path):
        return get_working_folder() / value
    if isinstance(value, Mapping):
        return {key: _make_absolute("", inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_make_absolute("", inner) for inner in value]
    if is_dataclass(value) and not isinstance(value, type):
        paths = {f.name: getattr(value, f.name, None) for f in fields(value)}
        paths = {part: _make_absolute("", path) for part, path in paths.items() if isinstance(path, Path)}
        return replace(value, **paths) if paths else value
    if name == "controller" and isinstance(value, str) and value.lower().partition(":")[0].endswith(_FILES):
        return str(get_working_folder() / value)
    return value


_FILES = (".fmu", ".py")
"""How the names of controllers end that are files."""

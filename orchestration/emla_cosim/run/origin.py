"""Origin of a run: the named scenario and the options set for it."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from ..base.files import get_working_folder
from .choices import resolve
from .options import list_options


@dataclass(frozen=True)
class RunOrigin:
    """The scenario of a run and the options that were set for it, by name.

    `source` is a name, or the absolute path of a file; None for a system made in Python. `sha256` is the
    hash of that file, or None if it is not a file. Paths among the options are absolute.
    """

    source: str | None = None
    sha256: str | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def updated(self, values: Mapping[str, Any]) -> "RunOrigin":
        """Return the origin with further options from `read_options`, merged as by `resolve`."""
        if not values:
            return self
        merged = resolve([self.overrides, with_gains(values)]).values
        names = [name for name in list_options() if name in merged]
        # a run may be repeated from another working folder
        return replace(self, overrides={name: _make_absolute(name, merged[name]) for name in names})


def read_origin(path: Path, content: bytes | None) -> RunOrigin:
    """Return the origin for a file with this content; `content` is None for a folder."""
    digest = None if content is None else hashlib.sha256(content).hexdigest()
    return RunOrigin(str(get_working_folder() / path), digest)


def with_gains(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return options in which a new controller gets its recommended gain set, unless one is set."""
    return {"gains": None, **values} if values.get("controller") is not None else values


def _make_absolute(name: str, value: Any) -> Any:
    """Return the value of an option with absolute paths. A controller can be the path of a file, too."""
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
"""Suffixes of controllers that are files."""

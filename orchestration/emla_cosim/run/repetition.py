"""Compare a run with the run that it repeats."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base.errors import join_names
from .options import list_options

Record = Mapping[str, Any]

MOST = 8
"""Most differences to name."""


def find_differences(before: Record, now: Record, given: Collection[str] = ()) -> list[str]:
    """List the differences between two runs by their run.json.

    Args:
        before: Record of the run that was repeated.
        now: Record of its repetition.
        given: Settings that were changed on purpose, by their names in run.json. They are left out, like
            settings that no run repeats.

    Returns:
        The differences as noun phrases. Unknown parts of `before` count as missing.
    """
    found = [*_versions(before, now), *_source(before, now), *_fmus(before, now)]
    found += _settings(before, now, given)
    if not found and not given:
        found = list(_wiring(before, now))
    return found


def describe_differences(found: Sequence[str], where: str) -> str:
    """Return a message with all differences from the run with this record."""
    named = list(found[:MOST])
    if len(found) > MOST:
        named.append(f"{len(found) - MOST} more")
    return f"Differences from {where}: {join_names(named)}."


def _versions(before: Record, now: Record) -> Iterator[str]:
    then, here = _table(before, "versions"), _table(now, "versions")
    for name, version in here.items():
        if name in then and then[name] != version:
            yield f"{name} {version or 'missing'} instead of {then[name] or 'missing'}"


def _source(before: Record, now: Record) -> Iterator[str]:
    then, here = before.get("source_sha256"), now["source_sha256"]
    if here is not None and then != here:
        yield f"the content of '{now['source']}'"


def _fmus(before: Record, now: Record) -> Iterator[str]:
    then, here = _table(before, "components"), _table(now, "components")
    for name, component in here.items():
        if name not in then:
            yield f"the component {name}, which is new"
        elif _table(then, name).get("sha256") != component["sha256"]:
            yield f"the FMU of {name}"
    yield from (f"the component {name}, which no longer exists" for name in then if name not in here)


def _settings(before: Record, now: Record, given: Iterable[str]) -> Iterator[str]:
    then, here = _table(before, "settings"), _table(now, "settings")
    may_differ = {*given, *(o.record for o in list_options().values() if not o.repeated)}
    for name in (n for n in here if n in then and n not in may_differ):
        yield from _describe_change(f"the setting {name}", then[name], here[name])


def _describe_change(name: str, then: Any, here: Any) -> Iterator[str]:
    """Yield the change of a setting. Of file paths only the last part counts, because folders may differ."""
    if isinstance(then, dict) and isinstance(here, dict) and "sha256" in here and "sha256" in then:
        if here["sha256"] != then["sha256"]:
            yield f"the content of '{here.get('file')}'"
        return
    parts: Iterable[tuple[Any, Any]] | None = None
    if isinstance(then, dict) and isinstance(here, dict) and then.keys() == here.keys():
        parts = ((then[key], here[key]) for key in here)
    elif isinstance(then, list) and isinstance(here, list) and len(then) == len(here):
        parts = zip(then, here, strict=True)
    if parts is not None:
        yield from dict.fromkeys(text for pair in parts for text in _describe_change(name, *pair))
    elif then != here and not _same_file(then, here):
        yield name


def _same_file(then: Any, here: Any) -> bool:
    texts = isinstance(then, str) and isinstance(here, str)
    return texts and Path(here).is_absolute() and Path(here).name == Path(then).name


def _wiring(before: Record, now: Record) -> Iterator[str]:
    """Yield differences of start values and connections that no other difference explains."""
    then, here = _table(before, "components"), _table(now, "components")
    for name, component in here.items():
        if _table(then, name).get("parameters") != component["parameters"]:
            yield f"the start values of {name}"
    if before.get("connections") != now["connections"]:
        yield "the connections"


def _table(record: Any, name: str) -> Record:
    """Return a table of a record, or an empty one if the entry is missing or of another type."""
    found = record.get(name)
    return found if isinstance(found, dict) else {}

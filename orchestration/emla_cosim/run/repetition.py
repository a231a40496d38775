"""A run beside the one that it repeats: what differs in what was run, and in what came out."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base.errors import join_names
from .options import list_options

Record = Mapping[str, Any]

MOST = 8
"""So many differences are named."""


def find_differences(before: Record, now: Record, given: Collection[str] = ()) -> list[str]:
    """What was run otherwise than before, as parts of a sentence, by both runs' run.json.

    Settings that are `given` anew, by their names in run.json, may differ, and those that no run repeats.
    Whatever `before` has that no run.json has counts as not there.
    """
    found = [*_versions(before, now), *_source(before, now), *_fmus(before, now)]
    found += _settings(before, now, given)
    if not found and not given:
        found = list(_wiring(before, now))
    return found


def describe_differences(found: Sequence[str], where: str) -> str:
    """One sentence with all differences to the run whose record this is."""
    named = list(found[:MOST])
    if len(found) > MOST:
        named.append(f"{len(found) - MOST} more")
    return f"Not as in {where}: {join_names(named)}."


def _versions(before: Record, now: Record) -> Iterator[str]:
    then, here = _table(before, "versions"), _table(now, "versions")
    for name, version in here.items():
        if name in then and then[name] != version:
            yield f"{name} {_or_none(version)} instead of {_or_none(then[name])}"


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
    yield from (f"the component {name}, which is gone" for name in then if name not in here)


def _settings(before: Record, now: Record, given: Iterable[str]) -> Iterator[str]:
    then, here = _table(before, "settings"), _table(now, "settings")
    may_differ = {*given, *(o.record for o in list_options().values() if not o.about.repeated)}
    for name in (n for n in here if n in then and n not in may_differ):
        yield from _describe_change(f"the setting {name}", then[name], here[name])


def _describe_change(name: str, then: Any, here: Any) -> Iterator[str]:
    """What became of a setting, where names of files count by their last part: where they lie may differ."""
    if isinstance(then, dict) and isinstance(here, dict):
        if "sha256" in here and "sha256" in then:
            if here["sha256"] != then["sha256"]:
                yield f"the content of '{here.get('file')}'"
            return
        if then.keys() == here.keys():
            found = (text for key in here for text in _describe_change(name, then[key], here[key]))
            yield from dict.fromkeys(found)
            return
    if isinstance(then, list) and isinstance(here, list) and len(then) == len(here):
        found = (
            text for old, new in zip(then, here, strict=True) for text in _describe_change(name, old, new)
        )
        yield from dict.fromkeys(found)
    elif then != here and not _same_file(then, here):
        yield name


def _same_file(then: Any, here: Any) -> bool:
    texts = isinstance(then, str) and isinstance(here, str)
    return texts and Path(here).is_absolute() and Path(here).name == Path(then).name


def _wiring(before: Record, now: Record) -> Iterator[str]:
    """Start values and connections, where nothing says why they differ."""
    then, here = _table(before, "components"), _table(now, "components")
    for name, component in here.items():
        if _table(then, name).get("parameters") != component["parameters"]:
            yield f"the start values of {name}"
    if before.get("connections") != now["connections"]:
        yield "the connections"


def _table(record: Any, name: str) -> Record:
    """A table of a record; an empty one where somebody made it something else."""
    found = record.get(name)
    return found if isinstance(found, dict) else {}


def _or_none(version: Any) -> str:
    return "not there" if version is None else str(version)

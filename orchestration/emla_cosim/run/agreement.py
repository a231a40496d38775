"""Compare a result with a stored run, and a run with the run that it repeats."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.tolerances import Comparison, describe_departure, select_outside

if TYPE_CHECKING:  # importing it loads polars
    from ..inputs.stored_runs import StoredRun
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from ..base.errors import join_names
from .options import list_options

_MOST_NAMES = 3
"""Most signals to name in a message; run.json has all."""


def find_common_signals(names: Sequence[str], stored: "StoredRun") -> list[str]:
    """Return the signals that a stored run has, too. Raise CommandError if there are none.

    Array columns of the stored run get the names of these signals.
    """
    stored.match_names(names)
    stored_names = set(stored.names)
    common = [name for name in names if name in stored_names]
    if not common:
        raise CommandError(
            f"the reference run '{stored.path}' has none of the recorded signals; it has "
            f"{stored.names[0]} and {len(stored.names) - 1} more."
        )
    return common


def align_values(
    time: Vector, values: Any, reference_time: Vector, reference: Any
) -> tuple[Vector, Vector, Vector]:
    """Return values, times of the reference and its values as doubles.

    Texts become numbers, equal for equal texts. Their reference gets the times of the values.
    """
    if object not in (values.dtype, reference.dtype):
        return values.astype(float), reference_time, reference.astype(float)
    # texts are held until the next row, and a rounded time counts as the same
    last = np.searchsorted(reference_time, time + 1e-9 * np.abs(time), side="right") - 1
    texts = np.concatenate([values.astype(str), reference[np.maximum(last, 0)].astype(str)])
    numbers = np.unique(texts, return_inverse=True)[1].astype(float)
    inside = (last >= 0) & (time <= reference_time[-1])
    return numbers[: len(values)], time[inside], numbers[len(values) :][inside]


def describe_disagreement(comparisons: Sequence[Comparison], stored: "StoredRun") -> str | None:
    """Return a message about the signals that left their tubes, earliest first, or None if all agree."""
    outside = select_outside(comparisons)
    if not outside:
        return None
    departures = "; ".join(describe_departure(c) for c in outside[:_MOST_NAMES])
    more = f"; and {len(outside) - _MOST_NAMES} more" if len(outside) > _MOST_NAMES else ""
    return (
        f"{len(outside)} of {len(comparisons)} signals do not agree with '{stored.path}': {departures}{more}."
    )


def describe_missing_part(end: float, step: float, stored: "StoredRun") -> str | None:
    """Return a message if a stored run continues for more than a step after the end of a run; times in s."""
    last = float(stored.read(["time"])["time"][-1])
    if last <= end + (1.0 + 1e-6) * step:
        return None
    return f"The run ended at {end:.6g} s, but '{stored.path}' continues until {last:.6g} s."


def build_agreement_record(comparisons: Sequence[Comparison], stored: "StoredRun") -> dict[str, Any]:
    """Return the entry of run.json: the number of signals, and those that left their tubes."""
    return {
        "run": str(stored.path),
        "signals": len(comparisons),
        "left": [
            {
                "signal": c.signal,
                "left_at_s": c.left_at,
                "worst": c.worst,
                "worst_at_s": c.worst_at,
                "tube": c.tube.value,
                "tube_s": c.tube.time,
            }
            for c in select_outside(comparisons)
        ],
    }


Record = Mapping[str, Any]

MOST = 8
"""Most differences to name."""


def find_differences(before: Record, now: Record, overrides: Collection[str]) -> list[str]:
    """List the differences between two runs by their run.json.

    Args:
        before: Record of the run that was repeated.
        now: Record of its repetition.
        overrides: Settings that were changed on purpose, by their names in run.json. They are left out, like
            settings that no run repeats.

    Returns:
        The differences as noun phrases. Unknown parts of `before` count as missing.
    """
    differences = [
        *_compare_versions(before, now),
        *_compare_sources(before, now),
        *_compare_fmus(before, now),
    ]
    differences += _compare_settings(before, now, overrides)
    # one of these differences would explain other start values and connections
    if not differences and not overrides:
        differences = list(_compare_wiring(before, now))
    return differences


def describe_differences(differences: Sequence[str], where: str) -> str:
    """Return a message with the differences from the run with this record, at most `MOST`."""
    listed = list(differences[:MOST])
    if len(differences) > MOST:
        listed.append(f"{len(differences) - MOST} more")
    return f"Differences from {where}: {join_names(listed)}."


def _compare_versions(before: Record, now: Record) -> Iterator[str]:
    """Yield the versions that differ; packages that the earlier record does not name are left out."""
    earlier, current = _read_table(before, "versions"), _read_table(now, "versions")
    for name, version in current.items():
        if name in earlier and earlier[name] != version:
            yield f"{name} {version or 'missing'} instead of {earlier[name] or 'missing'}"


def _compare_sources(before: Record, now: Record) -> Iterator[str]:
    earlier, current = before.get("source_sha256"), now["source_sha256"]
    if current is not None and earlier != current:
        yield f"the content of '{now['source']}'"


def _compare_fmus(before: Record, now: Record) -> Iterator[str]:
    earlier, current = _read_table(before, "components"), _read_table(now, "components")
    for name, component in current.items():
        if name not in earlier:
            yield f"the component {name}, which is new"
        elif _read_table(earlier, name).get("sha256") != component["sha256"]:
            yield f"the FMU of {name}"
    yield from (f"the component {name}, which no longer exists" for name in earlier if name not in current)


def _compare_settings(before: Record, now: Record, overrides: Iterable[str]) -> Iterator[str]:
    """Yield the settings that differ, among those that both records have."""
    earlier, current = _read_table(before, "settings"), _read_table(now, "settings")
    may_differ = {*overrides, *(o.record for o in list_options().values() if not o.repeated)}
    for name in (n for n in current if n in earlier and n not in may_differ):
        yield from _describe_change(f"the setting {name}", earlier[name], current[name])


def _describe_change(name: str, earlier: Any, current: Any) -> Iterator[str]:
    """Yield the change of a setting. Of file paths only the last part counts, because folders may differ."""
    parts: Iterable[tuple[Any, Any]] | None = None
    are_tables = isinstance(earlier, dict) and isinstance(current, dict)
    if are_tables and "sha256" in current and "sha256" in earlier:
        if current["sha256"] != earlier["sha256"]:
            yield f"the content of '{current.get('file')}'"
        return
    if are_tables and earlier.keys() == current.keys():
        parts = ((earlier[key], current[key]) for key in current)
    elif isinstance(earlier, list) and isinstance(current, list) and len(earlier) == len(current):
        parts = zip(earlier, current, strict=True)
    if parts is not None:
        yield from dict.fromkeys(text for pair in parts for text in _describe_change(name, *pair))
    elif earlier != current:
        is_same_file = (  # perhaps in another folder
            isinstance(earlier, str)
            and isinstance(current, str)
            and Path(current).is_absolute()
            and Path(current).name == Path(earlier).name
        )
        if not is_same_file:
            yield name


def _compare_wiring(before: Record, now: Record) -> Iterator[str]:
    """Yield differences of start values and connections that no other difference explains."""
    earlier, current = _read_table(before, "components"), _read_table(now, "components")
    for name, component in current.items():
        if _read_table(earlier, name).get("parameters") != component["parameters"]:
            yield f"the start values of {name}"
    if before.get("connections") != now["connections"]:
        yield "the connections"


def _read_table(record: Any, name: str) -> Record:
    """Return a table of a record, or an empty one if the entry is missing or of another type."""
    table = record.get(name)
    return table if isinstance(table, dict) else {}

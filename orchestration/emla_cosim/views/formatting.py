"""Format results as text for the terminal and for pages, with what joints idealize."""

import json
import math
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..base.wording import format_count, format_rounded
from ..pages.text import make_visible

if TYPE_CHECKING:
    from ..recorders.metrics import MetricDisplay
    from ..run.result import Result
from collections.abc import Sequence

from ..base.errors import join_names
from ..recorders.metrics import IDEALISED
from ..run.result import Result


def format_figure(value: Any, figure: "MetricDisplay") -> str:
    """Format a metric in the unit of its row, or in a larger one if it is large; "none" for NaN."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and figure.factor == 1:
        return str(value)
    scaled = figure.factor * value
    # NaN: the metric does not exist
    if value != value:
        return "none"
    # 1.2 m is easier to read than 1200000 µm
    if figure.large and abs(scaled) >= 1e4:
        return f"{value:.4g} {figure.large}"
    return format_rounded(scaled, 4)


def describe_stepping(result: "Result") -> Iterator[str]:
    """Yield messages on the steps: number, duration, iterations, coupling, overruns."""
    if not (result.wall_s > 0 and result.steps):
        return
    rate, factor = result.steps / result.wall_s, result.simulated_s / result.wall_s
    rejected = result.stepping.get("rejected_steps")
    rejected_text = f" ({rejected} more rejected)" if rejected is not None else ""
    threads = result.stepping.get("threads", 1)
    threads_text = f", in {threads} threads" if threads > 1 else ""
    yield (
        f"{format_count(result.steps, 'step')}{rejected_text} in {result.wall_s:.2f} s: "
        f"{rate:.0f} steps/s, {factor:.2g} x real time{threads_text}"
    )
    if (reason := result.stepping.get("compiled_code_not_kept")) is not None:
        yield f"The stepper in C could not be stored; the next run compiles it again: {reason}"
    loops = result.stepping.get("loops", [])
    if loops:
        each = result.stepping["sweeps_over_loops"] / len(loops) / result.steps
        loops_text = "One loop" if len(loops) == 1 else f"{len(loops)} loops"
        yield f"{loops_text} agreed after {each:.3g} {'sweep' if each == 1 else 'sweeps'} a step"
    coupling = result.record.get("coupling", {})
    yield from (coupling[name] for name in ("delay", "summary") if name in coupling)
    if result.pacing is not None:
        pacing = result.pacing
        yield (
            f"{format_count(int(pacing['overruns']), 'overrun')} at "
            f"{format_count(int(pacing['points']), 'point')} of "
            f"{pacing['factor']:g} x real time; "
            f"the longest delay was {1e3 * pacing['worst_delay_s']:.2f} ms"
        )


def list_signal_texts(
    result: "Result", most: int
) -> tuple[tuple[str, ...], list[tuple[str, tuple[str, ...], str]]]:
    """Return the names of the metrics of signals, and for each of the first signals name, values and unit."""
    names, rows = ("minimum", "maximum", "rms", "final"), list[tuple[str, tuple[str, ...], str]]()
    for signal, figures in islice(result.signals.items(), most):
        unit = result.units.get(signal)
        values = ("none" if math.isnan(figures[name]) else format_rounded(figures[name], 5) for name in names)
        rows.append((signal, tuple(values), "" if unit is None else str(unit)))
    return names, rows


PROFILE_COLUMNS = ("time / s", "share / %", "steps", "µs/step", "calls")
"""Titles of the columns of a profile, beside the names."""

_RECORDER_TITLES = {"metrics": "metrics", "table": "table of results", "waiting for real time": ""}
"""Titles of activities, by their names in run.json; those without a title keep their names."""


class ProfileRow(NamedTuple):
    """What took time, and its values as text, in the order of `PROFILE_COLUMNS`."""

    name: str
    values: tuple[str, ...]


def list_profile_rows(result: "Result", most: int) -> list[ProfileRow]:
    """Return where the time of a run went: FMUs first, the slowest ones one by one. Empty if not measured."""
    profile = result.profile
    if profile is None:
        return []
    rows, total = list[ProfileRow](), profile["total_s"]
    # the slowest one is what the user looks for
    fmus = sorted(profile["fmus"].items(), key=lambda item: -item[1]["seconds"])
    for name, measured in fmus[:most]:
        steps = measured["calls"].get("steps", {"count": 0, "seconds": 0.0})
        count = steps["count"]
        each = f"{1e6 * steps['seconds'] / count:.3g}" if count else ""
        calls = sum(call["count"] for call in measured["calls"].values())
        label = f"{name} (own process)" if measured["separate_process"] else name
        rows.append(_make_profile_row(label, measured["seconds"], total, str(count), each, str(calls)))
    if other_fmus := fmus[most:]:
        seconds = sum(measured["seconds"] for _, measured in other_fmus)
        rows.append(_make_profile_row(format_count(len(other_fmus), "other FMU"), seconds, total))
    rows.append(_make_profile_row("master", profile["master"]["seconds"], total))
    if (waiting := profile.get("separate_processes")) is not None:
        rows.append(_make_profile_row("waiting for other processes", waiting["seconds"], total))
    recorder_seconds, other_seconds = dict[str, float](), 0.0
    for name, measured in profile["recorders"].items():
        if name in _RECORDER_TITLES:
            recorder_seconds[_RECORDER_TITLES[name] or name] = measured["seconds"]
        else:
            other_seconds += measured["seconds"]
    rows += [_make_profile_row(name, seconds, total) for name, seconds in recorder_seconds.items()]
    rows.append(_make_profile_row("other recorders", other_seconds, total))
    rows.append(_make_profile_row("this measurement", profile["profiler"]["seconds"], total))
    return rows


def _make_profile_row(name: str, seconds: float, total: float, *more: str) -> ProfileRow:
    values = f"{seconds:.4g}", f"{100.0 * seconds / total if total else 0.0:.1f}", *more
    return ProfileRow(name, (*values, *("",) * (len(PROFILE_COLUMNS) - len(values))))


def format_headline(result: "Result") -> str:
    """Return the scenario and its overrides on one line, with file names without folders."""
    words = ", ".join(
        f"{name} {format_short(value)}".removeprefix("set ") for name, value in list_overrides(result)
    )
    return make_visible(f"Run of {result.name}{' with ' if words else ''}{words}").replace("\n", " ")


def format_short(value: Any) -> str:
    """Format a value briefly; of a file, show only its name."""
    if isinstance(value, Mapping) and "file" in value:
        return format_short(value["file"])
    if isinstance(value, list):
        return " and ".join(map(format_short, value))
    # folders differ between machines, and are long
    return Path(value).name if isinstance(value, str) and Path(value).is_absolute() else format_value(value)


def list_overrides(result: "Result") -> list[tuple[str, Any]]:
    """Return the overrides of the scenario: the name of an option or of what it sets, and the value."""
    overrides = []
    for name, value in (result.record.get("changed") or {}).items():
        if isinstance(value, Mapping):
            overrides += [(f"{name} {inner}", v) for inner, v in value.items()]
        else:
            overrides.append((name, value))
    return overrides


def format_value(value: Any) -> str:
    """Format a value of run.json."""
    if isinstance(value, str):
        return value
    if value is None or value in ({}, []):
        return "–"
    if isinstance(value, list) and all(isinstance(v, str) for v in value):
        return ", ".join(value)
    return json.dumps(value, ensure_ascii=False)


class IdealisationRow(NamedTuple):
    """What an object idealises, the option that removes it, and the source of typical values."""

    subject: str
    sentence: str
    option: str
    source: str


def list_idealisations(result: Result) -> list[IdealisationRow]:
    """Return all that objects of metrics idealise."""
    return [
        IdealisationRow(subject, entry["sentence"], entry["option"], entry["source"])
        for subject, entries in _map_idealisations(result).items()
        for entry in entries
    ]


def describe_idealisations(result: Result) -> str | None:
    """Return in one line what objects of metrics idealise; None if nothing."""
    subjects, sources = dict[str, list[str]](), dict[str, None]()
    for subject, entries in _map_idealisations(result).items():
        subjects.setdefault(", ".join(entry["label"] for entry in entries), []).append(subject)
        sources |= dict.fromkeys(entry["source"] for entry in entries if entry["source"])
    labels = {text: join_names(names) for text, names in subjects.items() if text}
    if not labels:
        return None
    # joints that idealise the same need no names
    parts = labels if len(subjects) == 1 else [f"{names}: {text}" for text, names in labels.items()]
    values = f"typical values: {', '.join(sources)}; " if sources else ""
    return f"Idealised: {'; '.join(parts)} ({values}metrics.json has the option for each)"


def _map_idealisations(result: Result) -> dict[str, Sequence[Mapping[str, str]]]:
    """Return what each object of metrics idealises, by its name."""
    kinds = result.metrics.values()
    return {of: figures[IDEALISED] for kind in kinds for of, figures in kind.items() if IDEALISED in figures}

"""Format results as text for the terminal and for pages."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.wording import format_count
from .pages.text import make_visible

if TYPE_CHECKING:
    from ..recorders.metrics import MetricDisplay
    from ..run.result import Result


def format_figure(value: Any, figure: "MetricDisplay") -> str:
    """Format a metric in the unit of its row, or in a larger one if it is large."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and figure.factor == 1:
        return f"{value:,}"
    scaled = figure.factor * value
    if value != value:
        return "none"
    if abs(scaled) < 1e4:
        return f"{scaled:.4g}"
    if figure.large:
        return f"{value:.4g} {figure.large}"
    return f"{scaled:,.0f}" if abs(scaled) < 1e12 else f"{scaled:.4g}"


def describe_stepping(result: "Result") -> Iterator[str]:
    """Yield messages on the steps: number, duration, iterations, late connections, overruns."""
    if not (result.wall_s > 0 and result.steps):
        return
    rate, factor = result.steps / result.wall_s, result.simulated_s / result.wall_s
    rejected = result.stepping.get("rejected_steps")
    tried = f" ({rejected} more rejected)" if rejected is not None else ""
    how = "" if result.stepping.get("compiled", True) else ", not compiled"
    if (threads := result.stepping.get("threads", 1)) > 1:
        how = f", in {threads} threads"
    yield (
        f"{format_count(result.steps, 'step')}{tried} in {result.wall_s:.2f} s: "
        f"{rate:,.0f} steps/s, {factor:.2g} x real time{how}"
    )
    if (reason := result.stepping.get("compiled_code_not_kept")) is not None:
        yield f"The compiled loop could not be stored; the next run compiles it again: {reason}"
    loops = result.stepping.get("loops", [])
    if loops:
        each = result.stepping["sweeps_over_loops"] / len(loops) / result.steps
        what = "One loop" if len(loops) == 1 else f"{len(loops)} loops"
        yield f"{what} agreed after {each:.3g} {'sweep' if each == 1 else 'sweeps'} a step"
    late = result.stepping["late_connections"]
    if late:
        come = format_count(len(late), "connection comes", "connections come")
        yield f"{come} one step late; run.json names {'it' if len(late) == 1 else 'them'}"
    if result.pacing is not None:
        kept = result.pacing
        yield (
            f"{format_count(int(kept['overruns']), 'overrun')} at "
            f"{format_count(int(kept['points']), 'point')} of "
            f"{kept['factor']:g} x real time; "
            f"the longest delay was {1e3 * kept['worst_delay_s']:.2f} ms"
        )


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
    return Path(value).name if isinstance(value, str) and Path(value).is_absolute() else format_value(value)


def list_overrides(result: "Result") -> list[tuple[str, Any]]:
    """Return the overrides of the scenario: the name of an option or of what it sets, and the value."""
    found = []
    for name, value in (result.record.get("changed") or {}).items():
        if isinstance(value, Mapping):
            found += [(f"{name} {inner}", v) for inner, v in value.items()]
        else:
            found.append((name, value))
    return found


def format_value(value: Any) -> str:
    """Format a value of run.json."""
    if isinstance(value, str):
        return value
    if value is None or value in ({}, []):
        return "–"
    if isinstance(value, list) and all(isinstance(v, str) for v in value):
        return ", ".join(value)
    return json.dumps(value, ensure_ascii=False)

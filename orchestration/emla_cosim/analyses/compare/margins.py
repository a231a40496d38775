"""Measure stability margins of each joint with each controller, where its reference moves fastest."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import polars

from ...base.errors import CosimError, RunError
from ...base.progress import Progress
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ..execution.worker_payload import Preparation
from ..linearize.measurement import NONLINEAR
from ..linearize.result import Measured
from ..linearize.runner import measure_loops
from ..variants.data import VariantOutcome
from ..variants.factors import find_start_values
from .measures import FASTEST_AT, LARGEST_SPEED
from .plan import ComparisonPlan

POSITION_LOOP, CURRENT_LOOP = "position_loop", "current_loop"

LOOPS: Mapping[str, str] = {
    POSITION_LOOP: "{0}",
    CURRENT_LOOP: "{0}.controller.u_q->{0}.plant.u_q",
}
"""Loops of a joint, and where each is opened, as for `linearize`."""

FIGURES = ("phase_margin_deg", "gain_margin_up_dB", "gain_margin_down_dB", "Ms", "delay_margin_s")
PROBLEM, AT, DELAY = "problem", "margins_at_s", "computing_delay_s"

_KEYS = ("scenario", "case", "joint", "controller", "gains")

COLUMNS: Mapping[str, Any] = {
    **dict.fromkeys(_KEYS, polars.String),
    AT: polars.Float64,
    DELAY: polars.Float64,
    **{
        f"{loop}_{name}": polars.String if name == PROBLEM else polars.Float64
        for loop in LOOPS
        for name in (*FIGURES, PROBLEM)
    },
}
"""Columns. A figure is null if nothing limits it, or if `..._problem` says why there is none."""

_DURATION = 1500
"""Length of responses in steps."""

_LATER, _CONSTANT = (0, 100, 200), 0.01
"""Steps to wait for a point at which the loop is constant, and the largest change of one that is. Margins
measured during a larger change differed by 20 degrees from those around it.
"""

_Motion = tuple[float, float]


def measure_margins(
    plan: ComparisonPlan,
    outcomes: Mapping[int, VariantOutcome],
    interrupted: Callable[[], bool],
    progress: Progress,
) -> polars.DataFrame:
    """Return a row with the margins of each joint, controller and set of gains.

    The operating point of all controllers is where the reference of the joint is fastest, or up to 200 steps
    later if the loop is not linear and constant there. An interrupt ends the measurement early.

    Args:
        plan: The runs.
        outcomes: What came out of them, measured with `MotionMeasures`.
        interrupted: Whether the user has interrupted.
        progress: Receives the progress.
    """
    motions = _find_motions(plan, outcomes)
    runs = list({run.group: run for run in reversed(plan.runs)}.values())[::-1]
    progress.begin("measuring margins", len(runs), "systems")
    rows = list[dict[str, Any]]()
    for run in runs:
        if interrupted():
            break
        for joint in run.joints:
            own = {
                "scenario": run.scenario,
                "case": run.case.name,
                "joint": joint,
                "controller": run.controller_variant.label,
                "gains": run.controller_variant.gains,
            }
            motion = motions.get((run.scenario, joint))
            rows.append(own | _measure(plan.groups[run.group], joint, motion, run.own["set"]))
        progress.advance(1)
    return polars.DataFrame(rows, schema=dict(COLUMNS), orient="row")


def add_margins(rows: polars.DataFrame, margins: polars.DataFrame | None) -> polars.DataFrame:
    """Return the rows of a comparison with the columns of its margins, if there are any."""
    return rows if margins is None else rows.join(margins, on=_KEYS, how="left", maintain_order="left")


def _find_motions(
    plan: ComparisonPlan, outcomes: Mapping[int, VariantOutcome]
) -> dict[tuple[str, str], _Motion]:
    """Return the largest speed of each reference and its time; runs that ended early may not reach it."""
    found = dict[tuple[str, str], _Motion]()
    for number, outcome in sorted(outcomes.items()):
        run = plan.runs[number]
        for joint in run.joints:
            figures, key = outcome.figures.get(joint, {}), (run.scenario, joint)
            if LARGEST_SPEED in figures and figures[LARGEST_SPEED] > found.get(key, (-1.0, 0.0))[0]:
                found[key] = figures[LARGEST_SPEED], figures[FASTEST_AT]
    return found


def _measure(
    part: Preparation, joint: str, motion: _Motion | None, values: Mapping[str, Any]
) -> dict[str, Any]:
    delays = {**find_start_values(f"{joint}.plant.inverter.delay", part.system, part.interfaces), **values}
    row: dict[str, Any] = {DELAY: delays.get(f"{joint}.plant.inverter.delay")}
    if motion is None:
        return row | {f"{loop}_{PROBLEM}": "no run reached the motion" for loop in LOOPS}
    times = run_times(part.options, part.name)
    count = min(_DURATION, times.steps // 2)
    first = round((motion[1] - times.start) / times.step)
    scenario = Scenario(part.name, "", part.system, part.options, resources=part.resources)
    opened = {loop: place.format(joint) for loop, place in LOOPS.items()}
    best, at = dict[str, Measured | CosimError](), 0.0
    for later in _LATER:
        point = times.point(max(0, min(first + later, times.steps - count)))
        found = measure_loops(scenario, list(opened.values()), point, count * times.step, values)
        if not best or _change(found) < _change(best):
            best, at = found, point
        if _change(best) < _CONSTANT:
            break
    for loop, place in opened.items():
        row |= {f"{loop}_{name}": value for name, value in _figures(best[place])}
    return row | {AT: at}


def _change(found: Mapping[str, Measured | CosimError]) -> float:
    """Return how much pulses of another size or a step later change the effect, relative to it."""
    return max(
        math.inf if isinstance(one, CosimError) else max(one.drift, one.nonlinearity)
        for one in found.values()
    )


def _figures(found: Measured | CosimError) -> Iterator[tuple[str, Any]]:
    """Return the figures of a loop, or the problem in words."""
    if isinstance(found, CosimError):
        yield PROBLEM, found.fields.get("reason", "run ended" if isinstance(found, RunError) else str(found))
        return
    margins = found.margins
    assert margins is not None
    if not margins.has_crossover:
        yield PROBLEM, f"gain stays {'above' if found.response.gain_dB[0] > 0.0 else 'below'} 1"
        return
    if found.drift > NONLINEAR:
        yield PROBLEM, "changes with time"
        return
    values = (margins.phase_deg, margins.gain_up_dB, margins.gain_down_dB, margins.Ms, margins.delay_s)
    for name, value in zip(FIGURES, values, strict=True):
        yield name, value if math.isfinite(value) else None

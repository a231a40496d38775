"""What options make of a run: its communication points, its rows, and the signals that are kept."""

import difflib
from collections.abc import Sequence

from ..base.errors import CommandError
from ..base.patterns import matches_pattern
from ..master.stepping.pacing import Pacing
from ..master.stepping.timing import MAXIMUM_STEPS, CommunicationPoints, make_communication_points
from ..recorders.stored import open_stored_run
from ..system.model import System
from .options import Options
from .requirements import parse_requirement

DEFAULT_INTERVAL = 1e-3
"""Time in s between rows of a table unless told otherwise."""


def check_run(options: Options, name: str) -> None:
    """Raise CommandError for what can be seen to be wrong before anything is built."""
    steps_per_row(options, run_times(options, name))
    options.make_algorithm()
    options.make_step_size_control()
    for text in options.require:
        parse_requirement(text)
    if options.reference is not None:
        open_stored_run(options.reference)
    if options.real_time is not None:
        Pacing(options.real_time)


def run_times(options: Options, name: str) -> CommunicationPoints:
    """The communication points of a run; CommandError where nobody says how long it is or its steps."""
    if options.stop_time is None:
        raise CommandError(f"'{name}' does not say when to stop; give --stop-time.")
    if options.step_size is None:
        raise CommandError(f"'{name}' does not say how long a step is; give --step-size.")
    return make_communication_points(options.stop_time, options.step_size, options.start_time or 0.0)


def steps_per_row(options: Options, times: CommunicationPoints) -> int:
    """Fixed steps in an output interval; without one 1 ms, or every step if that does not fit.

    Raises CommandError where the interval is not a whole number of steps.
    """
    interval = options.output_interval
    chosen = max(DEFAULT_INTERVAL, times.step) if interval is None else interval
    if not 0.0 < chosen < float("inf"):
        raise CommandError(f"the output interval {chosen:g} s must be a positive number of seconds.")
    if (times.stop - times.start) / chosen > MAXIMUM_STEPS:
        raise CommandError(f"an output interval of {chosen:g} s makes more than {MAXIMUM_STEPS:g} rows.")
    if not options.make_step_size_control().is_regular:
        return 1
    every = round(chosen / times.step)
    if every >= 1 and abs(every * times.step - chosen) <= 1e-9 * chosen:
        return every
    if interval is None:
        return max(every, 1)
    raise CommandError(
        f"the output interval {chosen:g} s is not a whole number of steps of {times.step:g} s."
    )


def select_signals(patterns: Sequence[str], names: Sequence[str]) -> Sequence[int]:
    """Positions of the signals to keep, all without a pattern; CommandError for one that finds nothing."""
    if not patterns:
        return range(len(names))
    return _matching(patterns, names, "signal", "results have all without.")


def select_isolated(patterns: Sequence[str], system: System) -> list[str]:
    """Components to run in processes of their own; CommandError for a pattern that finds none."""
    names = [c.name for c in system.components]
    return [names[i] for i in _matching(patterns, names, "component", "--isolate alone isolates all.")]


def _matching(patterns: Sequence[str], names: Sequence[str], kind: str, otherwise: str) -> list[int]:
    """Positions of names that one of the patterns finds; CommandError for a pattern that finds none."""
    chosen: set[int] = set()
    for pattern in patterns:
        found = [i for i, name in enumerate(names) if matches_pattern(name, pattern)]
        if not found:
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.5)
            meant = f"did you mean {' or '.join(near)}?" if near else otherwise
            raise CommandError(f"no {kind} is called '{pattern}'; {meant}", name=pattern, near=near)
        chosen.update(found)
    return sorted(chosen)

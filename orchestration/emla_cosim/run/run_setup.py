"""Communication points, rows and recorded signals of a run, from its options."""

import difflib
from collections.abc import Collection, Sequence

from ..base.errors import CommandError
from ..base.patterns import matches_pattern
from ..inputs.stored_runs import open_stored_run
from ..master.stepping.pacing import Pacing
from ..master.stepping.timing import MAXIMUM_STEPS, CommunicationPoints, make_communication_points
from ..system.model import System
from .options import Options
from .requirements import parse_requirement

DEFAULT_INTERVAL = 1e-3
"""Default time between rows of a table in s."""


def check_run(options: Options, name: str) -> None:
    """Raise CommandError for errors that can be found before anything is built."""
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
    """Return the communication points. Raise CommandError if the stop time or the step size is missing."""
    if options.stop_time is None:
        raise CommandError(f"'{name}' has no stop time; set --stop-time.")
    if options.step_size is None:
        raise CommandError(f"'{name}' has no step size; set --step-size.")
    return make_communication_points(options.stop_time, options.step_size, options.start_time or 0.0)


def steps_per_row(options: Options, times: CommunicationPoints) -> int:
    """Return the number of fixed steps per output interval.

    The default interval is 1 ms, or one step if 1 ms is not a whole number of steps.

    Raises:
        CommandError: If the interval is not a whole number of steps.
    """
    interval = options.output_interval
    chosen = max(DEFAULT_INTERVAL, times.step) if interval is None else interval
    if not 0.0 < chosen < float("inf"):
        raise CommandError(f"the output interval {chosen:g} s must be a positive number of seconds.")
    if (times.stop - times.start) / chosen > MAXIMUM_STEPS:
        raise CommandError(f"an output interval of {chosen:g} s makes more than {MAXIMUM_STEPS:g} rows.")
    if not options.make_step_size_control().is_regular:
        return 1
    every = round(min(chosen / times.step, 1e18))  # the quotient may be infinite
    if every >= 1 and abs(every * times.step - chosen) <= 1e-9 * chosen:
        return every
    if interval is None:
        return max(every, 1)
    raise CommandError(
        f"the output interval {chosen:g} s is not a whole number of steps of {times.step:g} s."
    )


def select_signals(patterns: Sequence[str], names: Sequence[str], further: Collection[str] = ()) -> list[str]:
    """Return the signals to keep, in the order of `names`, then of `further`.

    Args:
        patterns: names or patterns of signals. Without one, all `names` are kept.
        names: outputs.
        further: other variables. A name or pattern selects them if it matches no output.

    Raises:
        CommandError: a pattern has no match.
    """
    if not patterns:
        return list(names)
    own = [p for p in patterns if p not in further and any(matches_pattern(n, p) for n in names)]
    others = [p for p in patterns if p not in own]
    kept = [names[i] for i in _matching(own, names, "signal", "")]
    known = [*further, *names] if others else []  # a similar name may be among both
    return kept + [
        known[i] for i in _matching(others, known, "signal", "without --signals, all outputs are kept.")
    ]


def select_components(patterns: Sequence[str], system: System, otherwise: str) -> list[str]:
    """Return the components that match patterns of an option.

    Args:
        patterns: Names or patterns of components.
        system: The system.
        otherwise: What an error message says if no name is similar.

    Raises:
        CommandError: A pattern has no match.
    """
    names = [c.name for c in system.components]
    return [names[i] for i in _matching(patterns, names, "component", otherwise)]


def _matching(patterns: Sequence[str], names: Sequence[str], kind: str, otherwise: str) -> list[int]:
    """Return the positions of the names that match. Raise CommandError for a pattern without a match."""
    chosen: set[int] = set()
    for pattern in patterns:
        found = [i for i, name in enumerate(names) if matches_pattern(name, pattern)]
        if not found:
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.5)
            meant = f"did you mean {' or '.join(near)}?" if near else otherwise
            raise CommandError(f"no {kind} matches '{pattern}'; {meant}", name=pattern, near=near)
        chosen.update(found)
    return sorted(chosen)

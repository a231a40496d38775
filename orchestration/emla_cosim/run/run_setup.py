"""Communication points, rows and recorded signals of a run, from its options."""

from collections.abc import Collection, Iterable, Sequence

from ..base.errors import CommandError
from ..base.patterns import find_names, select_names
from ..fmu.elements import BINARY
from ..inputs.stored_runs import open_stored_run
from ..master.stepping.pacing import Pacing
from ..master.stepping.timing import MAXIMUM_STEPS, CommunicationPoints, make_communication_points
from ..system.model import System
from ..system.names import NamedVariable
from .options import Options
from .requirements import parse_requirement

DEFAULT_INTERVAL = 1e-3
"""Default time between rows of a table in s."""

FEW_ROWS, MANY_ROWS = 10, 100
"""A run shorter than so many default intervals has about so many rows, or one per step."""

_MOST_UNASKED = 50
"""Most signals that are recorded without being asked for."""


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

    The default interval is 1 ms, a step that is longer, or a fraction of a run that is short.

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
    if _is_short(options, times):
        return max(times.steps // MANY_ROWS, 1)
    every = round(min(chosen / times.step, 1e18))  # the quotient may be infinite
    if every >= 1 and abs(every * times.step - chosen) <= 1e-9 * chosen:
        return every
    if interval is None:
        return max(every, 1)
    raise CommandError(
        f"the output interval {chosen:g} s is not a whole number of steps of {times.step:g} s."
    )


def describe_interval(options: Options, times: CommunicationPoints) -> list[str]:
    """Return a remark on the distance of rows, if the run is too short for the default one."""
    if not (_is_short(options, times) and options.make_step_size_control().is_regular):
        return []
    every = steps_per_row(options, times)
    distance = f"every {every * times.step:g} s" if every > 1 else "after each step"
    return [f"the run is short: its rows are {distance}, not every 1 ms (--output-interval)."]


def _is_short(options: Options, times: CommunicationPoints) -> bool:
    """Return whether a run would have few rows at the default interval, although its steps are shorter."""
    is_brief = times.stop - times.start < (FEW_ROWS - 0.5) * DEFAULT_INTERVAL
    return options.output_interval is None and is_brief and times.steps > 0 and times.step < DEFAULT_INTERVAL


def select_signals(
    patterns: Sequence[str], names: Sequence[str], further: Collection[str] = (), main: str = ""
) -> list[str]:
    """Return the signals to keep, in the order of `names`, then of `further`.

    Args:
        patterns: names or patterns of signals. Without one, all `names` are kept.
        names: outputs.
        further: other variables. A name or pattern selects them if it matches no output.
        main: component whose variables need no component's name; empty without one.

    Raises:
        CommandError: a pattern has no match.
    """
    if not patterns:
        return list(names)
    of_outputs = [p for p in patterns if p not in further and find_names(p, names, main)]
    others = [p for p in patterns if p not in of_outputs]
    outputs = {*select_names(of_outputs, names, "signal", main)}
    every = [*further, *names] if others else []  # a similar name may be among both
    hint = "without --signals, all outputs are kept."
    rest = {*select_names(others, every, "signal", main, hint)}
    return [n for n in names if n in outputs] + [n for n in every if n in rest]


def choose_fallback_signals(others: Iterable[NamedVariable]) -> tuple[list[str], str]:
    """Return the signals to record without outputs: the states, or else the local variables; and a remark.

    Args:
        others: Variables that the option `signals` can name.
    """
    variables = [v for v in others if v.variable.type not in ("String", BINARY)]
    rates = [(v.component.name, v.variable.derivative) for v in variables]
    states = {(component, state.name) for component, state in rates if state is not None}
    of_kind = {
        "continuous states": [v.full_name for v in variables if v.end in states],
        "local variables": [v.full_name for v in variables if str(v.variable.causality) == "local"],
    }
    said = "No FMU has an output of a number"
    for kind, names in of_kind.items():
        if names:
            few = f"the {kind}"
            if len(names) > _MOST_UNASKED:
                few = f"the first {_MOST_UNASKED} of the {len(names)} {kind}"
            return names[:_MOST_UNASKED], f"{said}; {few} are recorded instead. Set --signals to choose."
    said += ", a state or a local variable"
    return [], f"{said}; only `time` is recorded. Set --signals to record others."


def select_components(patterns: Sequence[str], system: System, otherwise: str) -> list[str]:
    """Return the components that match patterns of an option, in the order of the system.

    Args:
        patterns: Names or patterns of components.
        system: The system.
        otherwise: What an error message says if no name is similar.

    Raises:
        CommandError: A pattern has no match.
    """
    names = [c.name for c in system.components]
    selected = {*select_names(patterns, names, "component", hint=otherwise)}
    return [name for name in names if name in selected]

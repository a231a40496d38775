"""Compute frequency responses of a system at a time of a run."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np

from ...base.errors import CommandError, CosimError
from ...base.progress import Progress
from ...run.option_types import RunOptions
from ...run.remarks import describe_disabled_event_mode
from ...run.requirements import check_no_condition
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ...run.simulation import Simulation
from ...study.joint import ideal_sensors
from ...study.loading import load
from ...system.fault import Fault
from ...system.model import System, Value
from ..frame.session import Session
from .matrices import ContinuousSystem, compute_matrices, find_steady_state
from .measurement import add_step_changes, measure
from .perturbation import AnalysisPoint, Perturbation, check_reached, choose_openings, parse_opening
from .report import OUTPUTS
from .response import FrequencyResponse
from .result import LinearizeResult, MeasuredResponse

SAMPLES = 2000
"""Default length of a response in steps."""

_MIN_SAMPLES = 20

_REPORTED_NONLINEARITY, _REPORTED_DRIFT = 0.01, 0.02


def linearize(
    source: str | Path | System,
    *,
    open: str | Sequence[str] = (),
    perturb: str | Sequence[str] = (),
    read: str | Sequence[str] = (),
    at: float | None = None,
    duration: float | None = None,
    amplitude: float | None = None,
    matrices: bool = False,
    steady: bool = False,
    free: str | Sequence[str] = (),
    output: str | Path | None = None,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[RunOptions],
) -> LinearizeResult:
    """Compute frequency responses and stability margins of a system at a time of a run.

    The system runs to the operating point. From there it runs repeatedly, once undisturbed, then with pulses
    of one step on an input; the differences are the responses. They belong to the system as it is simulated,
    with its sampling, hold and delays. Noise and steps of the sensors in joints are switched off, unless you
    set their parameters.

    Args:
        source: scenario, as for `load`.
        open: where to open a loop: a connection `a.output->b.input`, a path inside of a component
            `a.input->a.output`, or the name of a joint, for its measured position. Default: at the current
            reference of each joint, unless `perturb` and `read` are set.
        perturb: full names of inputs of responses, connected or not.
        read: full names of outputs of responses.
        at: time of the operating point in s. Default: the stop time less the duration.
        duration: length of the responses in s. Default: 2000 steps, at most half of the run.
        amplitude: height of the pulses, in the unit of the input. Default: the height with the most linear
            effect.
        matrices: compute the state matrices from the inputs `perturb` to the outputs `read` instead, with
            poles and damping. All FMUs must run as Model Exchange. `at` is the stop time by default.
        steady: compute the matrices at the nearest steady state, where the derivatives of all states are 0.
        free: inputs whose values may change to find the steady state.
        output: folder for results.
        plots: draw Bode and Nyquist plots into the folder.
        report: write a page, linearize.html, into the folder.
        progress: receives the progress.
        **options: options as for `load`.

    Returns:
        The responses, and the margins of the loops; or the matrices.

    Raises:
        CommandError: a name or a time does not fit.
        RunError: the system is unstable or not linear at this time, there is no steady state, or a run fails.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.linearize("lift", open="lift.controller.u_q->lift.plant.u_q", stop_time=0.1)
        >>> margins = result.margins["lift.controller.u_q -> lift.plant.u_q"]
        >>> 30.0 < margins.phase_deg < 90.0
        True
    """
    scenario = load(source, **options)
    check_no_condition(scenario.options.stop_when, "linearize")
    if matrices:
        if _to_list(open) or duration is not None or amplitude is not None:
            raise CommandError(
                "state matrices are not measured with pulses; leave out 'open', 'duration' and 'amplitude', "
                "or 'matrices'."
            )
        points, openings = [], []
    elif steady or free:
        raise CommandError("a steady state is for state matrices only; set 'matrices', too.")
    else:
        texts = _to_list(open), _to_list(perturb), _to_list(read)
        openings = [] if any(texts) else choose_openings(scenario.system)
        points = _list_points(scenario.system, openings or texts[0], *texts[1:])
    session = Session(OUTPUTS, output, scenario.options.overwrite, plots, report, progress=progress)
    session.check_unread([scenario.options.files_read()])
    with session.reserve_folder():
        # steps of a coarse sensor would hide small pulses; what the user sets stays
        values = ideal_sensors(scenario.system) | dict(scenario.options.set)
        if matrices:
            with scenario.prepare(session.progress, set=values) as simulation:
                names = _to_list(perturb), _to_list(read), _to_list(free)
                result = _compute_matrices(scenario, simulation, *names, at, steady)
        else:
            start, length = _choose_interval(scenario, at, duration)
            # an offset of 0 is a connection: the pulse needs one to add to
            ends = [
                Fault(p.input, "offset", start=0.0, value=0.0)
                for p in points
                if _is_undriven(scenario.system, p)
            ]
            faults = [*scenario.options.fault, *{f.signal: f for f in ends}.values()]
            with scenario.prepare(session.progress, fault=faults, set=values) as simulation:
                try:
                    result = _measure_all(
                        scenario.name, simulation, points, start, length, amplitude, session.progress
                    )
                except CommandError as error:
                    if not openings:
                        raise
                    joint = openings[0].partition(".")[0]
                    raise CommandError(
                        f"{error} By default, loops are opened at the current reference; for the measured "
                        f"position, set 'open' to {joint} (--open {joint})."
                    ) from error
        remarks = describe_disabled_event_mode(simulation.system)
        result = replace(result, remarks=(*remarks, *result.remarks))
        session.keep(result)
    return result


def measure_loops(
    scenario: Scenario, loops: Sequence[str], at: float, duration: float, values: Mapping[str, Value]
) -> dict[str, MeasuredResponse | CosimError]:
    """Measure loops one by one, so that one without margins leaves the others.

    Args:
        scenario: The scenario.
        loops: Where to open loops, as for `linearize`.
        at: Time of the operating point in s.
        duration: Length of the responses in s.
        values: Start values that differ. Noise and steps of the sensors are off.

    Returns:
        What was measured for each loop, or the error that explains why there are no margins.
    """
    start, length = _choose_interval(scenario, at, duration)
    measured = dict[str, MeasuredResponse | CosimError]()
    try:
        with (
            scenario.prepare(set={**values, **ideal_sensors(scenario.system)}) as simulation,
            closing(Perturbation(simulation, start, length)) as perturbation,
        ):
            for loop in loops:
                try:
                    measured[loop] = measure(perturbation, parse_opening(scenario.system, loop))
                except CosimError as error:
                    measured[loop] = error
    except CosimError as error:
        return dict.fromkeys(loops, error)
    return measured


def describe_missing_crossover(label: str, response: FrequencyResponse) -> str:
    """Return a message on a loop whose gain is 1 at no frequency."""
    is_above = response.gain_dB[0] > 0.0
    text = (
        f"{label}: the loop gain stays {'above' if is_above else 'below'} 1 from {response.frequency[0]:.3g} "
        f"to {response.frequency[-1]:.4g} Hz, so there is no phase margin."
    )
    if is_above:
        return text
    return (
        f"{text} A limit, such as that of the current, may cut the loop; then the other margins do not say "
        "that it is stable."
    )


def _to_list(names: str | Sequence[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _list_points(
    system: System, openings: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]
) -> list[AnalysisPoint]:
    """Return the points of loops, and of each pair of input and output; CommandError if there are none."""
    if bool(inputs) != bool(outputs):
        raise CommandError(
            "a frequency response needs an input and an output; set both 'perturb' and 'read'."
        )
    pairs = [AnalysisPoint(f"{a} to {b}", a, b) for a in inputs for b in outputs]
    points = [*(parse_opening(system, text) for text in openings), *pairs]
    if not points:
        raise CommandError("nothing to compute; set 'open', or 'perturb' and 'read'.")
    return list({p.label: p for p in points}.values())


def _compute_matrices(
    scenario: Scenario,
    simulation: Simulation,
    inputs: Sequence[str],
    outputs: Sequence[str],
    free: Sequence[str],
    at: float | None,
    steady: bool,
) -> LinearizeResult:
    """Return the state matrices at a time in s, or at the steady state that is nearest to the state there."""
    times = run_times(scenario.options, scenario.name)
    at = times.stop if at is None else at
    if not times.start <= at <= times.stop:
        raise CommandError(
            f"the operating point t = {at:g} s is outside of the run, {times.start:g} s to {times.stop:g} s."
        )
    if free and not steady:
        raise CommandError("'free' inputs are for a steady state; set 'steady', too.")
    simulation.start(recorders=[], estimate_coupling=False)
    simulation.advance(at)
    check_reached(simulation, at)
    system = ContinuousSystem(simulation, list(dict.fromkeys([*inputs, *free])), outputs)
    states, shifts = system.read_states(), np.zeros(len(system.inputs))
    if steady:
        states, shifts = find_steady_state(system, free)
    state_space, remarks = compute_matrices(system, states, shifts)
    return LinearizeResult(scenario.name, at, times.step, False, {}, tuple(remarks), state_space, steady)


def _is_undriven(system: System, point: AnalysisPoint) -> bool:
    """Return whether nothing drives the input of an analysis point."""
    component, variable = system.split(point.input)
    input_name = component.alias(variable).variable
    return all(x.input != input_name for x in system.into(component.name))


def _choose_interval(scenario: Scenario, at: float | None, duration: float | None) -> tuple[float, float]:
    """Return the operating point in s, on a communication point, and the length of the responses in s."""
    times = run_times(scenario.options, scenario.name)
    default = min(SAMPLES, times.steps // 2)
    count = default if duration is None else round(duration / times.step)
    first = times.steps - count if at is None else round((at - times.start) / times.step)
    if count < _MIN_SAMPLES:
        raise CommandError(
            f"a response of {count * times.step:g} s has {count} steps; it needs at least {_MIN_SAMPLES}. "
            "Choose a longer duration or a later stop time."
        )
    if not 0 <= first <= times.steps - count:
        raise CommandError(
            f"responses of {count * times.step:g} s from t = {times.start + first * times.step:g} s are not "
            f"within the run, {times.start:g} s to {times.stop:g} s. Choose another time, a shorter "
            "duration or a later stop time."
        )
    return times.point(first), count * times.step


def _measure_all(
    name: str,
    simulation: Simulation,
    points: Sequence[AnalysisPoint],
    at: float,
    duration: float,
    amplitude: float | None,
    progress: Progress,
) -> LinearizeResult:
    """Measure the response at each point, also with half the step."""
    with closing(Perturbation(simulation, at, duration)) as perturbation:
        for point in points:
            perturbation.resolve(point)  # report wrong names before anything is measured
        progress.begin("measuring", 2 * len(points))
        responses = dict[str, MeasuredResponse]()
        for point in points:
            responses[point.label] = measure(perturbation, point, amplitude)
            progress.advance(1)
    remarks = [text for label, m in responses.items() for text in _describe_limits(label, m)]
    responses, judgement = add_step_changes(simulation, points, perturbation.at, duration, responses)
    progress.advance(len(points))
    at, step, rolls_back = perturbation.at, perturbation.step, perturbation.rolls_back
    return LinearizeResult(name, at, step, rolls_back, responses, (*remarks, *judgement))


def _describe_limits(label: str, measured: MeasuredResponse) -> list[str]:
    """Return remarks on a response without crossover, not linear, or changing with time."""
    remarks = []
    if measured.margins is not None and not measured.margins.has_crossover:
        remarks.append(describe_missing_crossover(label, measured.response))
    if measured.nonlinearity > _REPORTED_NONLINEARITY:
        remarks.append(
            f"{label} is not quite linear: effects of two pulses differ by "
            f"{100.0 * measured.nonlinearity:.2g} %."
        )
    if measured.drift > _REPORTED_DRIFT:
        remarks.append(
            f"{label} changes with time: a pulse one step later has an effect that differs by "
            f"{100.0 * measured.drift:.2g} %. A component may sample more slowly than the step size, or the "
            "system moves quickly."
        )
    return remarks

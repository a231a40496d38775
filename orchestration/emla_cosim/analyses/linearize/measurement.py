"""Measure frequency responses: choose the amplitude, check linearity, transform, judge the step.

The same response with half the step shows how much of it the communication step makes.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, CosimError, RunError
from ...run.half_step import halve_step
from ...run.simulation import Simulation
from .perturbation import AnalysisPoint, Perturbation, ResolvedPoint
from .response import (
    Complex,
    FrequencyResponse,
    compute_margins,
    count_integrators,
    is_growing,
    relative_norm,
    transform_response,
)
from .result import MeasuredResponse

_HEIGHTS = (1.0, 3.0, 10.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
"""Heights of pulses to try, relative to the size of the input: large ones first, as sensors are coarse."""

_GOOD_NONLINEARITY, NONLINEAR = 1e-3, 0.05
"""Nonlinearity at which no other amplitude is tried, and above which there is no linear response."""


_POINTS = 400
"""Number of frequencies."""


LARGEST_CHANGE = 0.02
"""Relative change of a response above which it is reported, as for one that changes with time."""

_LIMITS = (
    ("the phase margin", "phase_deg", "°", math.degrees(LARGEST_CHANGE)),
    ("the upper gain margin", "gain_up_dB", " dB", 20.0 * math.log10(1.0 + LARGEST_CHANGE)),
    ("the lower gain margin", "gain_down_dB", " dB", 20.0 * math.log10(1.0 + LARGEST_CHANGE)),
    ("the crossover frequency", "phase_at", " Hz", LARGEST_CHANGE),
)
"""Margins with their units, and what a change of the loop gain by 2 % makes of them; that of the crossover
is relative.
"""

_MAX_FREQUENCY = 0.1
"""Frequency, as a part of the sample rate, up to which responses are compared."""


@dataclass(frozen=True)
class _Reaction:
    """The change of a signal by a pulse, its linear part, and how much other pulses differ."""

    amplitude: float
    positive: Vector
    linear: Vector
    nonlinearity: float


def measure(
    perturbation: Perturbation,
    point: AnalysisPoint,
    amplitude: float | None = None,
    frequency: Vector | None = None,
) -> MeasuredResponse:
    """Return the frequency response at an analysis point.

    A loop is measured while it is closed, so that the system stays at its operating point. A pulse d is added
    to the input, which then is u = S d with the sensitivity S = 1 / (1 + L). The loop gain is L = 1 / S - 1.

    Args:
        perturbation: The system at its operating point.
        point: The analysis point.
        amplitude: Height of the pulse; None chooses the one with the smallest nonlinearity.
        frequency: Frequencies in Hz. Default: evenly spaced on a logarithmic axis, from that with one period
            in the response.

    Raises:
        CommandError: The signals do not exist, or do not react.
        RunError: The system is unstable or not linear here, or the response does not decay.
    """
    resolved = perturbation.resolve(point)
    reaction = _find_linear_reaction(perturbation, resolved, point, amplitude)
    _check_reaction(perturbation, point, reaction)
    integrators = count_integrators(reaction.linear)
    if integrators is None or (integrators and point.is_loop):
        raise RunError(
            f"the effect of a pulse on {point.input} has not decayed after {perturbation.duration:g} s; "
            "choose a longer duration.",
            reason="not decayed",
        )
    # a system that does not change with time has the same response a sample later
    later = perturbation.respond(resolved, reaction.amplitude, at=1)
    drift = relative_norm(later[1:] - reaction.positive[:-1], reaction.positive)
    step = perturbation.step
    if frequency is None:
        frequency = np.geomspace(1.0 / perturbation.duration, 0.5 / step, _POINTS)
    # the response to one pulse alone differs by the nonlinearity, which estimates the error
    samples = [
        _normalize_response(point, x / reaction.amplitude) for x in (reaction.linear, reaction.positive)
    ]
    H, rough = (transform_response(x, integrators, frequency, step) for x in samples)
    if not point.is_loop:
        unit = perturbation.unit(point)
        response = FrequencyResponse(point.label, frequency, H, _estimate_error(H, rough), step, unit)
        return MeasuredResponse(response, reaction.amplitude, reaction.nonlinearity, drift)
    L, rough = 1.0 / H - 1.0, 1.0 / rough - 1.0
    response = FrequencyResponse(point.label, frequency, L, _estimate_error(L, rough), step, "1")
    margins = compute_margins(frequency, L)
    return MeasuredResponse(response, reaction.amplitude, reaction.nonlinearity, drift, margins)


def _find_linear_reaction(
    perturbation: Perturbation, resolved: ResolvedPoint, point: AnalysisPoint, amplitude: float | None
) -> _Reaction:
    """Return the most linear reaction to pulses of several heights.

    Raises:
        CommandError: The output does not react.
        RunError: The run fails with each height.
    """
    scale = perturbation.scale(resolved)
    best: _Reaction | None = None
    failure: RunError | None = None
    for height in [f * scale for f in _HEIGHTS] if amplitude is None else [amplitude]:
        try:
            reaction = _measure_reaction(perturbation, resolved, height)
        except RunError as error:  # so large a pulse may end the run
            failure = error
            continue
        if best is None or reaction.nonlinearity < best.nonlinearity:
            best = reaction
        # each height costs two runs
        if best.nonlinearity < _GOOD_NONLINEARITY:
            break
    if best is None and failure is not None:
        raise failure
    if best is None or best.nonlinearity == float("inf"):
        raise CommandError(
            f"{point.output or point.input} does not react to {point.input}: {point.label} has no response."
        )
    return best


def _measure_reaction(perturbation: Perturbation, resolved: ResolvedPoint, height: float) -> _Reaction:
    """Return the reaction to pulses of `height` and -`height` / 2.

    With y = h d + q d^2 both together give h d = (y(d) - 4 y(-d / 2)) / 3.
    """
    positive = perturbation.respond(resolved, height)
    negative = perturbation.respond(resolved, -0.5 * height)
    # the quadratic parts are equal after the factor 4, and cancel
    linear = (positive - 4.0 * negative) / 3.0
    direct = np.zeros(len(positive))
    if resolved.output is None:  # the input is read with the pulse itself, which is linear in any case
        direct[0] = height
    return _Reaction(height, positive, linear, relative_norm(positive + 2.0 * negative, positive - direct))


def _check_reaction(perturbation: Perturbation, point: AnalysisPoint, reaction: _Reaction) -> None:
    """Raise RunError if the system is unstable or not linear here."""
    at = f"at t = {perturbation.at:g} s"
    if point.is_loop and is_growing(reaction.linear):
        raise RunError(
            f"the system is unstable {at}: the effect of a pulse on {point.input} grows. Choose another time "
            "or other gains.",
            reason="unstable",
        )
    if reaction.nonlinearity > NONLINEAR:
        raise RunError(
            f"{point.label} is not linear {at}: effects of pulses of other size and sign differ by "
            f"{100.0 * reaction.nonlinearity:.2g} %. Saturation, backlash, friction or a coarse sensor may "
            "cause this. Choose another time or amplitude.",
            reason="not linear",
        )


def _normalize_response(point: AnalysisPoint, samples: Vector) -> Vector:
    """Return the response to a pulse of 1: the sensitivity of a loop, or the output at communication points.

    Inside of a component the pulse reaches the output with a gain, that of its first sample.
    """
    if not point.output:
        return samples
    if not point.is_loop:
        return np.concatenate([[0.0], samples[:-1]])  # outputs were read at the end of each step
    if abs(samples[0]) <= 1e-9 * np.abs(samples).max():
        raise CommandError(
            f"{point.output} does not react to {point.input} without delay, so the loop cannot be opened "
            "between them. A parameter such as feed_acceleration may switch this path off."
        )
    return samples / samples[0]


def _estimate_error(H: Complex, rough: Complex) -> Vector:
    return np.abs(rough - H) / np.maximum(np.abs(H), 1e-300)


def add_step_changes(
    simulation: Simulation,
    points: Sequence[AnalysisPoint],
    at: float,
    duration: float,
    responses: Mapping[str, MeasuredResponse],
) -> tuple[dict[str, MeasuredResponse], list[str]]:
    """Return responses with their change by half the step, and remarks.

    Args:
        simulation: The prepared system.
        points: Where the responses were measured.
        at: Time of the operating point in s.
        duration: Length of the responses in s.
        responses: What was measured, by label.
    """
    judged_responses, remarks = dict(responses), list[str]()
    try:
        half = halve_step(simulation, {})
        with closing(Perturbation(simulation, at, duration, half.options)) as perturbation:
            for point in points:
                measured = judged_responses[point.label]
                halved = measure(perturbation, point, measured.amplitude, measured.response.frequency)
                change = _find_relative_change(measured.response, halved.response)
                compared = replace(measured, margins_at_half_step=halved.margins, step_change=change)
                judged_responses[point.label] = compared
                subject, change, ratio = _find_worst(compared)
                if ratio > 1.0:
                    remarks.append(
                        f"{point.label}: half the step changes {subject} by {change}, so the step makes a "
                        f"part of it; {half.suggest(ratio)}."
                    )
    except CosimError as error:
        remarks.append(f"The step is not judged: {str(error).rstrip('.')}.")
    return judged_responses, remarks


def _find_relative_change(response: FrequencyResponse, halved: FrequencyResponse) -> float:
    """Return the relative change of a response, root mean square up to a tenth of the sample rate."""
    # near half the sample rate, a hold of half the length always changes the response
    slow = response.frequency <= _MAX_FREQUENCY / response.step
    change = np.abs(halved.value - response.value) / np.maximum(np.abs(response.value), 1e-300)
    return float(np.sqrt(np.mean(change[slow] ** 2)))


def _find_worst(measured: MeasuredResponse) -> tuple[str, str, float]:
    """Return the subject that changes most, its change, and this as a multiple of the limit."""
    margins, halved_margins = measured.margins, measured.margins_at_half_step
    if margins is None or halved_margins is None:
        change = measured.step_change or 0.0
        return "the response", f"{100.0 * change:.2g} %", change / LARGEST_CHANGE
    worst = "the margins", "", 0.0
    for subject, name, unit, limit in _LIMITS:
        before, after = getattr(margins, name), getattr(halved_margins, name)
        ratio = abs(after - before) / (limit * (before if name == "phase_at" else 1.0))
        # a margin that is infinite before or after has no change to compare
        if math.isfinite(ratio) and ratio > worst[2]:
            worst = subject, f"{after - before:+.3g}{unit}", ratio
    return worst

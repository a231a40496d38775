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
from .margins import Margins, compute_margins
from .perturbation import Perturbation
from .places import Place, ResolvedPlace
from .response import (
    Complex,
    FrequencyResponse,
    count_integrators,
    is_growing,
    relative_norm,
    transform_response,
)
from .result import Measured

_FACTORS = (1.0, 3.0, 10.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
"""Heights of pulses to try, relative to the size of the input: large ones first, as sensors are coarse."""

_GOOD, NONLINEAR = 1e-3, 0.05
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

_FASTEST = 0.1
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
    place: Place,
    amplitude: float | None = None,
    frequency: Vector | None = None,
) -> Measured:
    """Return the frequency response at a place.

    A loop is measured while it is closed, so that the system stays at its operating point. A pulse d is added
    to the input, which then is u = S d with the sensitivity S = 1 / (1 + L). The loop gain is L = 1 / S - 1.

    Args:
        perturbation: The system at its operating point.
        place: The place.
        amplitude: Height of the pulse; None chooses the one with the smallest nonlinearity.
        frequency: Frequencies in Hz. Default: evenly spaced on a logarithmic axis, from that with one period
            in the response.

    Raises:
        CommandError: The place does not exist, or does not react.
        RunError: The system is unstable or not linear here, or the response does not decay.
    """
    resolved = perturbation.resolve(place)
    found = _react(perturbation, resolved, place, amplitude)
    _check(perturbation, place, found)
    integrators = count_integrators(found.linear)
    if integrators is None or (integrators and place.is_loop):
        raise RunError(
            f"the effect of a pulse on {place.input} has not decayed after {perturbation.duration:g} s; "
            "choose a longer duration.",
            reason="not decayed",
        )
    later = perturbation.respond(resolved, found.amplitude, at=1)
    drift = relative_norm(later[1:] - found.positive[:-1], found.positive)
    step = perturbation.step
    if frequency is None:
        frequency = np.geomspace(1.0 / perturbation.duration, 0.5 / step, _POINTS)
    values = [_per_pulse(place, signal / found.amplitude) for signal in (found.linear, found.positive)]
    H, other = (transform_response(v, integrators, frequency, step) for v in values)
    if not place.is_loop:
        unit = perturbation.unit(place)
        response = FrequencyResponse(place.label, frequency, H, _error(H, other), step, unit)
        return Measured(response, found.amplitude, found.nonlinearity, drift)
    L, other = 1.0 / H - 1.0, 1.0 / other - 1.0
    response = FrequencyResponse(place.label, frequency, L, _error(L, other), step, "1")
    return Measured(response, found.amplitude, found.nonlinearity, drift, compute_margins(frequency, L))


def _react(
    perturbation: Perturbation, resolved: ResolvedPlace, place: Place, amplitude: float | None
) -> _Reaction:
    """Return the most linear reaction to pulses of several heights."""
    scale = perturbation.scale(resolved)
    best: _Reaction | None = None
    failure: RunError | None = None
    for height in [f * scale for f in _FACTORS] if amplitude is None else [amplitude]:
        try:
            found = _reaction(perturbation, resolved, height)
        except RunError as error:  # so large a pulse may end the run
            failure = error
            continue
        if best is None or found.nonlinearity < best.nonlinearity:
            best = found
        if best.nonlinearity < _GOOD:
            break
    if best is None and failure is not None:
        raise failure
    if best is None or best.nonlinearity == float("inf"):
        raise CommandError(
            f"{place.output or place.input} does not react to {place.input}: {place.label} has no response."
        )
    return best


def _reaction(perturbation: Perturbation, resolved: ResolvedPlace, height: float) -> _Reaction:
    """Return the reaction to pulses of `height` and -`height` / 2.

    With y = h d + q d^2 both together give h d = (y(d) - 4 y(-d / 2)) / 3.
    """
    positive = perturbation.respond(resolved, height)
    negative = perturbation.respond(resolved, -0.5 * height)
    linear = (positive - 4.0 * negative) / 3.0
    own = np.zeros(len(positive))
    if resolved.output is None:  # the input is read with the pulse itself, which is linear in any case
        own[0] = height
    return _Reaction(height, positive, linear, relative_norm(positive + 2.0 * negative, positive - own))


def _check(perturbation: Perturbation, place: Place, found: _Reaction) -> None:
    at = f"at t = {perturbation.at:g} s"
    if place.is_loop and is_growing(found.linear):
        raise RunError(
            f"the system is unstable {at}: the effect of a pulse on {place.input} grows. Choose another time "
            "or other gains.",
            reason="unstable",
        )
    if found.nonlinearity > NONLINEAR:
        raise RunError(
            f"{place.label} is not linear {at}: effects of pulses of other size and sign differ by "
            f"{100.0 * found.nonlinearity:.2g} %. Saturation, backlash, friction or a coarse sensor may "
            "cause this. Choose another time or amplitude.",
            reason="not linear",
        )


def _per_pulse(place: Place, samples: Vector) -> Vector:
    """Return the response to a pulse of 1: the sensitivity of a loop, or the output at communication points.

    Inside of a component the pulse reaches the output with a gain, that of its first sample.
    """
    if not place.output:
        return samples
    if not place.is_loop:
        return np.concatenate([[0.0], samples[:-1]])  # outputs were read at the end of each step
    if abs(samples[0]) <= 1e-9 * np.abs(samples).max():
        raise CommandError(
            f"{place.output} does not react to {place.input} without delay, so the loop cannot be opened "
            "between them. A parameter such as feed_acceleration may switch this path off."
        )
    return samples / samples[0]


def _error(H: Complex, other: Complex) -> Vector:
    return np.abs(other - H) / np.maximum(np.abs(H), 1e-300)


def judge_step(
    simulation: Simulation,
    places: Sequence[Place],
    at: float,
    duration: float,
    responses: Mapping[str, Measured],
) -> tuple[dict[str, Measured], list[str]]:
    """Return responses with what half the step makes of them, and remarks.

    Args:
        simulation: The prepared system.
        places: Where the responses were measured.
        at: Time of the operating point in s.
        duration: Length of the responses in s.
        responses: What was measured, by label.
    """
    found, remarks = dict(responses), list[str]()
    try:
        half = halve_step(simulation, {})
        with closing(Perturbation(simulation, at, duration, half.options)) as perturbation:
            for place in places:
                whole = found[place.label]
                halved = measure(perturbation, place, whole.amplitude, whole.response.frequency)
                change = _compare(whole.response, halved.response)
                judged = replace(whole, margins_at_half_step=halved.margins, step_change=change)
                found[place.label] = judged
                subject, change, ratio = _find_worst(judged)
                if ratio > 1.0:
                    remarks.append(
                        f"{place.label}: half the step changes {subject} by {change}, so the step makes a "
                        f"part of it; {half.suggest(ratio)}."
                    )
    except CosimError as error:
        remarks.append(f"The step is not judged: {str(error).rstrip('.')}.")
    return found, remarks


def _compare(whole: FrequencyResponse, halved: FrequencyResponse) -> float:
    """Return the relative change of a response."""
    slow = whole.frequency <= _FASTEST / whole.step
    change = np.abs(halved.value - whole.value) / np.maximum(np.abs(whole.value), 1e-300)
    return float(np.sqrt(np.mean(change[slow] ** 2)))


def _find_worst(measured: Measured) -> tuple[str, str, float]:
    """Return what changes most, its change, and this as a multiple of the limit."""
    whole, halved = measured.margins, measured.margins_at_half_step
    if whole is None or halved is None:
        change = measured.step_change or 0.0
        return "the response", f"{100.0 * change:.2g} %", change / LARGEST_CHANGE
    return max((_compare_margin(whole, halved, *limit) for limit in _LIMITS), key=lambda one: one[2])


def _compare_margin(
    whole: Margins, halved: Margins, subject: str, name: str, unit: str, limit: float
) -> tuple[str, str, float]:
    """Return a margin, its change as text, and this as a multiple of the limit."""
    before, after = getattr(whole, name), getattr(halved, name)
    if not (math.isfinite(before) and math.isfinite(after)):
        return subject, "", 0.0
    change = after - before
    return subject, f"{change:+.3g}{unit}", abs(change) / (limit * (before if name == "phase_at" else 1.0))

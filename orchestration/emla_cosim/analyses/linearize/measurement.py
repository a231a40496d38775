"""Measure one frequency response: choose the amplitude, check linearity, transform."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from .margins import compute_margins
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


@dataclass(frozen=True)
class _Reaction:
    """The change of a signal by pulses.

    Attributes:
        amplitude: Height of the first pulse.
        positive: Change by this pulse.
        linear: Its linear part.
        nonlinearity: Difference to the effect of a pulse of other size and sign.
    """

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
    heights: Iterable[float] = [f * scale for f in _FACTORS] if amplitude is None else [amplitude]
    best: _Reaction | None = None
    failure: RunError | None = None
    for height in heights:
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

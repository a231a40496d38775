"""How much of a frequency response the communication step makes: the same response with half the step."""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from ...base.errors import CosimError
from ...run.half_step import halve_step
from ...run.simulation import Simulation
from .margins import Margins
from .measurement import measure
from .perturbation import Perturbation
from .places import Place
from .response import FrequencyResponse
from .result import Measured

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

"""Bode and Nyquist plots of frequency responses."""

from typing import TYPE_CHECKING

import numpy as np

from ...views.plots.style import COLORS, GREY, RED, new_figure, tidy_axes
from .result import LinearizeResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RADIUS = 3.0
"""Largest |L| in a Nyquist plot; what is farther out decides no margin."""


def draw_bode(result: LinearizeResult) -> "Figure":
    """Draw gain and phase of all responses; points with an estimated error above 10 % are left out."""
    figure, axes = new_figure(2, 1, 6.5, 2.6)
    gain, phase = axes[:, 0]
    labels = []
    for i, (name, measured) in enumerate(result.responses.items()):
        response, known = measured.response, measured.response.error < 0.1
        color = COLORS[i % len(COLORS)]
        gain.semilogx(response.frequency, np.where(known, response.gain_dB, np.nan), color=color)
        phases = response.phase_deg
        if measured.margins is not None:  # turned so that -180 degrees are those of the phase margin
            crossing = int(np.argmin(np.abs(response.gain_dB)))
            phases = phases - 360.0 * np.round((phases[crossing] + 180.0) / 360.0)
        phase.semilogx(response.frequency, np.where(known, phases, np.nan), color=color)
        labels.append(f"{name} / ({response.unit})" if measured.margins is None else name)
    tidy_axes(gain, labels)
    if result.margins:
        gain.axhline(0.0, color=GREY, linewidth=0.8)
        phase.axhline(-180.0, color=GREY, linewidth=0.8)
    tidy_axes(phase)
    gain.set_ylabel("gain / dB", fontsize=9)
    phase.set_ylabel("phase / °", fontsize=9)
    phase.set_xlabel("frequency / Hz", fontsize=9)
    return figure


def draw_nyquist(result: LinearizeResult) -> "Figure":
    """Draw the loop gains near -1, with the circle that they may not enter at their Ms."""
    figure, axes = new_figure(1, 1, 5.0, 4.6)
    plot = axes[0, 0]
    for i, (name, margins) in enumerate(result.margins.items()):
        L, color = result[name].value, COLORS[i % len(COLORS)]
        shown = np.where(np.abs(L) < 2.0 * _RADIUS, L, np.nan)
        plot.plot(np.real(shown), np.imag(shown), color=color)
        plot.add_patch(_circle(1.0 / margins.Ms, color))
    labels = [f"{name}, Ms = {m.Ms:.3g}" for name, m in result.margins.items()]
    tidy_axes(plot, labels)
    plot.plot([-1.0], [0.0], "+", color=RED, markersize=9)
    plot.add_patch(_circle(1.0, GREY, 0.0))
    plot.set(xlim=(-_RADIUS, 1.0), ylim=(-2.0, 2.0), aspect="equal")
    plot.set_xlabel("real part of L", fontsize=9)
    plot.set_ylabel("imaginary part of L", fontsize=9)
    return figure


def _circle(radius: float, color: str, center: float = -1.0) -> "object":
    from matplotlib.patches import Circle

    return Circle((center, 0.0), radius, fill=False, color=color, linewidth=0.8, linestyle="--")

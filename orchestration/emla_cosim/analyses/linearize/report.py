"""The report of a linearization: margins or poles, how they were measured, Bode and Nyquist plots."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...views.plots.style import COLORS, GREY, RED, new_figure, tidy_axes
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section
from .response import StateSpace
from .result import LinearizeResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BODE, _NYQUIST = "bode.png", "nyquist.png"

_RADIUS = 3.0
"""Largest |L| in a Nyquist plot; points farther out do not decide a margin."""

_MARGINS = (
    ("phase margin", "phase_deg", "phase_at", "°", 1.0),
    ("gain margin, up", "gain_up_dB", "gain_up_at", "dB", 1.0),
    ("gain margin, down", "gain_down_dB", "gain_down_at", "dB", 1.0),
    ("delay margin", "delay_s", None, "ms", 1e3),
    ("sensitivity Ms", "Ms", "Ms_at", "", 1.0),
)


def build_report(result: LinearizeResult) -> Report:
    """Return the report of a linearization."""
    notes = [f"Note: {text}" for text in result.remarks]
    facts = [f"t = {result.at:g} s", f"step {1e3 * result.step:g} ms"]
    if result.matrices is not None:
        tables = [_tabulate_point(result, result.matrices), _tabulate_poles(result.matrices)]
        return Report("Linearization", result.name, facts, [Section(tables=tables, under=notes)])
    how = "restored states" if result.rolled_back else "repeated runs, as not every FMU can restore its state"
    measured = [
        f"{name}: pulses of {m.amplitude:.3g}, nonlinearity {100.0 * m.nonlinearity:.2g} %"
        + ("" if m.step_change is None else f", change by half the step {100.0 * m.step_change:.2g} %")
        for name, m in result.responses.items()
    ]
    pictures = {
        _BODE: "Gain and phase of the responses over frequency",
        _NYQUIST: "Loop gains near -1, with the circles that they may not enter",
    }
    under = [*notes, *measured, f"Measured with {how}"]
    section = Section(tables=list(_tabulate_margins(result)), pictures=pictures, under=under)
    return Report("Linearization", result.name, facts, [section])


def _tabulate_margins(result: LinearizeResult) -> Iterator[ReportTable]:
    for name, margins in result.margins.items():
        halved = result.responses[name].margins_at_half_step
        rows = list[list[str]]()
        for label, value, at, unit, factor in _MARGINS:
            margin, frequency = getattr(margins, value), None if at is None else getattr(margins, at)
            is_finite = math.isfinite(margin)
            rows.append(
                [
                    label,
                    f"{factor * margin:.4g}" if is_finite else "none",
                    unit if is_finite else "",
                    f"{frequency:.4g}" if is_finite and frequency is not None else "",
                    "not judged" if halved is None else _format(factor * (getattr(halved, value) - margin)),
                ]
            )
        header = ("", "margin", "", "at / Hz", "half step")
        yield ReportTable(f"{name}, t = {result.at:g} s", header, rows, texts=(0, 2))


def _format(difference: float) -> str:
    """Return the change of a margin as text; empty if there is no margin before or after."""
    return f"{difference:+.2g}" if math.isfinite(difference) else ""


def _tabulate_poles(matrices: StateSpace) -> ReportTable:
    rows = [
        [
            f"{pole.real:.5g}",
            f"±{pole.imag:.5g}" if pole.imag > 0.0 else "0",
            f"{abs(pole) / (2.0 * math.pi):.4g}",
            f"{damping:.4g}",
        ]
        for pole, damping in zip(matrices.poles, matrices.damping, strict=True)
        if pole.imag >= 0.0
    ]
    header = ("real / s⁻¹", "imaginary / s⁻¹", "frequency / Hz", "damping")
    return ReportTable("Poles", header, rows, texts=())


def _tabulate_point(result: LinearizeResult, matrices: StateSpace) -> ReportTable:
    where = f"steady state near t = {result.at:g} s" if result.is_steady else f"t = {result.at:g} s"
    rows = [
        [kind.removesuffix("s"), name, f"{value:.6g}", matrices.units[name]]
        for kind in ("states", "inputs", "outputs")
        for name, value in zip(getattr(matrices, kind), getattr(matrices, f"at_{kind}"), strict=True)
    ]
    return ReportTable(f"Operating point, {where}", ("", "name", "value", "unit"), rows, texts=(0, 1, 3))


def draw_bode(result: LinearizeResult) -> "Figure":
    """Draw gain and phase of all responses; points with an estimated error above 10 % are left out."""
    figure, axes = new_figure(2, 1, 6.5, 2.6)
    gain, phase = axes[:, 0]
    labels = []
    for i, (name, measured) in enumerate(result.responses.items()):
        response, is_reliable = measured.response, measured.response.error < 0.1
        color = COLORS[i % len(COLORS)]
        gain.semilogx(response.frequency, np.where(is_reliable, response.gain_dB, np.nan), color=color)
        phases = response.phase_deg
        if measured.margins is not None:  # turned so that -180 degrees are those of the phase margin
            crossing = int(np.argmin(np.abs(response.gain_dB)))
            phases = phases - 360.0 * np.round((phases[crossing] + 180.0) / 360.0)
        phase.semilogx(response.frequency, np.where(is_reliable, phases, np.nan), color=color)
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
        near = np.where(np.abs(L) < 2.0 * _RADIUS, L, np.nan)
        plot.plot(np.real(near), np.imag(near), color=color)
        plot.add_patch(_make_circle(1.0 / margins.Ms, color))
    labels = [f"{name}, Ms = {m.Ms:.3g}" for name, m in result.margins.items()]
    tidy_axes(plot, labels)
    plot.plot([-1.0], [0.0], "+", color=RED, markersize=9)
    plot.add_patch(_make_circle(1.0, GREY, 0.0))
    plot.set(xlim=(-_RADIUS, 1.0), ylim=(-2.0, 2.0), aspect="equal")
    plot.set_xlabel("real part of L", fontsize=9)
    plot.set_ylabel("imaginary part of L", fontsize=9)
    return figure


def _make_circle(radius: float, color: str, center: float = -1.0) -> "object":
    from matplotlib.patches import Circle

    return Circle((center, 0.0), radius, fill=False, color=color, linewidth=0.8, linestyle="--")


def _draw(result: LinearizeResult) -> "Iterator[tuple[str, Figure]]":
    if result.responses:
        yield _BODE, draw_bode(result)
    if result.margins:
        yield _NYQUIST, draw_nyquist(result)


OUTPUTS = Outputs[LinearizeResult](
    subject="linearization",
    name="linearize",
    tables={"responses.csv": lambda result: result.table.write_csv() if result.responses else None},
    report=build_report,
    draw=_draw,
    pictures=(_BODE, _NYQUIST),
)

"""Plots of a joint with all its candidates: motor and winding, motion and load, and the use of its limits."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...study.actuator.entries import TURN
from ...views.plots.style import (
    BLUE,
    COLORS,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    add_legend,
    make_figure,
    new_figure,
    tidy_axes,
)
from .limits import format_percent, format_value
from .motor import Winding, continuous_torque, heat, peak_torque
from .result import JointSizing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Sizings = Mapping[str, JointSizing]
"""A joint with each of its candidates, by label."""

_MAX_POINTS = 4000
"""Largest number of points of a drawn curve."""

_TIME_CONSTANTS = 5.0
"""Thermal time constants over which the temperature is drawn."""

_MAX_CYCLES = 40
"""Up to this number of cycles, each is drawn; of more, only the highest and the lowest temperature."""

_MAX_PERCENT = 200.0
"""Longer bars are cut."""


class _Curves(NamedTuple):
    """A candidate to draw: its label (empty for the only one), its colours, and the width of its curves.

    Later candidates are thinner, so that those below remain visible.
    """

    sizing: JointSizing
    label: str
    limit: str
    cycle: str
    lasting: str
    mean: str
    width: float = 1.5

    def name(self, text: str) -> str:
        """Return the label of the main curve: that of the candidate, if there are several."""
        return self.label or text


def _make_curves(sizings: Sizings) -> list[_Curves]:
    """Return the candidates to draw; each of several has one colour."""
    if len(sizings) == 1:
        return [_Curves(sizing, "", RED, BLUE, ORANGE, GREEN) for sizing in sizings.values()]
    drawn = list[_Curves]()
    for number, (label, sizing) in enumerate(sizings.items()):
        color, width = COLORS[number % len(COLORS)], 1.2 + 0.6 * (len(sizings) - 1 - number)
        drawn.append(_Curves(sizing, label, color, color, color, color, width))
    return drawn


def draw_motor(sizings: Sizings) -> "Figure":
    """Draw torque and force over speed, winding temperature, and power."""
    drawn = _make_curves(sizings)
    figure, axes = new_figure(2, 2, 4.6, 3.3, sharex="none")
    for draw, of in zip((_draw_torque, _draw_force, _draw_temperature, _draw_power), axes.flat, strict=True):
        draw(of, drawn)
    first = drawn[0].sizing
    title = f"{first.joint}: {first.actuator}" if len(drawn) == 1 else first.joint
    figure.suptitle(title if len(title) < 90 else f"{title[:87]}...", fontsize=11, parse_math=False)
    return figure


def draw_motion(sizings: Sizings) -> "Figure":
    """Draw position, speed and axial force over the cycle."""
    figure, axes = new_figure(1, 3, 3.0, 2.6, sharex="none")
    legends = [_Legend(panel) for panel in axes[0]]
    for curves in _make_curves(sizings):
        cycle = curves.sizing.cycle
        part = _select_points(len(cycle.time))
        time = cycle.time[part] - cycle.time[0]
        for legend, values in zip(legends, (1e3 * cycle.x, 1e3 * cycle.v, 1e-3 * cycle.force), strict=True):
            legend.plot(curves.label, time, values[part], color=curves.cycle, linewidth=curves.width)
    for legend, label in zip(legends, ("position / mm", "speed / mm/s", "axial force / kN"), strict=True):
        legend.finish("time / s", label, is_shown=len(sizings) > 1 and legend is legends[0])
    return figure


def draw_limits(sizings: Sizings) -> "Figure":
    """Draw how much of each limit is used: a bar for each candidate, with the worst draw of tolerances."""
    drawn = _make_curves(sizings)
    names = list(dict.fromkeys(limit.name for curves in drawn for limit in curves.sizing.limits))
    figure = make_figure(10.0, 0.9 + len(names) * (0.12 + 0.2 * len(drawn)), layout="constrained")
    axes = figure.subplots()
    height = 0.85 / len(drawn)
    entries: list[tuple[str, Artist]] = []
    for number, curves in enumerate(drawn):
        study = curves.sizing.tolerances
        uses = () if study is None else study.limits(curves.sizing.limits)
        worst = {use.worst.name: 100.0 * use.worst.fraction for use in uses}
        for limit in curves.sizing.limits:
            y = names.index(limit.name) + height * (number - 0.5 * (len(drawn) - 1))
            percent = 100.0 * limit.fraction
            (bar,) = axes.barh(y, min(percent, _MAX_PERCENT), 0.9 * height, color=curves.cycle)
            if number == len(entries):
                entries.append((curves.label, bar))
            ends = np.minimum([percent, worst.get(limit.name, percent)], _MAX_PERCENT)
            if study is not None:
                axes.plot(ends, [y, y], color=GREY, linewidth=1.2, marker="|", markersize=6)
            text = f"{format_percent(limit.fraction)} % of {format_value(limit.limit)} {limit.unit}"
            axes.text(max(ends) + 2.0, y, text, va="center", fontsize=7, parse_math=False)
    axes.axvline(100.0, color=RED)
    axes.set_yticks(range(len(names)), names)
    tidy_axes(axes)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.35 * max(100.0, axes.get_xlim()[1]))
    axes.set_xlabel("used / %", fontsize=9)
    if len(drawn) > 1:
        add_legend(axes, entries, width=9.0)
    return figure


def _select_points(count: int) -> slice:
    return slice(None, None, max(count // _MAX_POINTS, 1))


def _draw_torque(axes: "Axes", drawn: list[_Curves]) -> None:
    rpm, legend = 60.0 / TURN, _Legend(axes)
    for curves in drawn:
        values, cycle, style = curves.sizing.values, curves.sizing.cycle, {"linewidth": curves.width}
        omega, torque = rpm * np.abs(cycle.omega), np.abs(cycle.torque)
        speed = np.linspace(0.0, max(values["motor.n_max"], 1.05 * float(np.abs(cycle.omega).max())), 200)
        beyond = speed > values["motor.n_max"]
        peak, lasting = peak_torque(cycle.emla, speed), continuous_torque(values, speed)
        y = np.where(beyond, np.nan, peak)
        legend.plot(curves.name("peak torque"), rpm * speed, y, color=curves.limit, **style)
        part = _select_points(len(omega))
        legend.plot("cycle", omega[part], torque[part], color=curves.cycle, linewidth=0.8)
        row = [int(torque.argmax())]  # thinned rows may lack it
        mark = {"color": curves.cycle, "marker": "x", "linestyle": ""}
        legend.plot("peak of the cycle", omega[row], torque[row], **mark)
        if lasting is not None:
            y = np.where(beyond, np.nan, lasting)
            style |= {"color": curves.lasting, "linestyle": "--"}
            legend.plot("limit of the rms torque", rpm * speed, y, **style)
        x, y = [rpm * cycle.rms(cycle.omega)], [curves.sizing.figures.torque_rms_N_m]
        legend.plot("rms of the cycle", x, y, color=curves.mean, marker="o", linestyle="")
    legend.finish("motor speed / rpm", "motor torque / N m")
    axes.set_ylim(bottom=0.0)


def _draw_force(axes: "Axes", drawn: list[_Curves]) -> None:
    """Draw axial force over speed.

    The curves are the motor's through gearbox and screw, without inertia; the lines are limits of the screw.
    """
    legend = _Legend(axes)
    for curves in drawn:
        cycle, emla = curves.sizing.cycle, curves.sizing.cycle.emla
        ratio = emla.alpha_RL * emla.eta_GB
        speed = np.linspace(0.0, max(emla.v_max, 1.05 * float(np.abs(cycle.v).max())), 200)
        beyond, omega = speed > emla.v_max, emla.alpha_RL * speed
        y = 1e-3 * np.where(beyond, np.nan, peak_torque(emla, omega) * ratio)
        name = curves.name("force of the peak torque")
        legend.plot(name, 1e3 * speed, y, color=curves.limit, linewidth=curves.width)
        part = _select_points(len(cycle.time))
        x, y = 1e3 * np.abs(cycle.v[part]), 1e-3 * np.abs(cycle.force[part])
        legend.plot("cycle", x, y, color=curves.cycle, linewidth=0.8)
        if (lasting := continuous_torque(curves.sizing.values, omega)) is not None:
            y = 1e-3 * np.where(beyond, np.nan, lasting * ratio)
            style = {"color": curves.lasting, "linestyle": "--"}
            legend.plot("force of the continuous torque", 1e3 * speed, y, **style)
        limits = {limit.name: limit.limit for limit in curves.sizing.limits}
        for name, style in (("axial force", "-."), ("screw static load", ":")):
            if name in limits:
                legend.line(f"limit of the {name}", limits[name], color=curves.limit, linestyle=style)
    legend.finish("speed / mm/s", "axial force / kN")
    axes.set_ylim(bottom=0.0)


def _draw_temperature(axes: "Axes", drawn: list[_Curves]) -> None:
    """Draw the temperature rise from cold over cycles, with its limits."""
    warm = [curves for curves in drawn if curves.sizing.rise is not None]
    if not warm:
        needs = drawn[0].sizing.winding
        text = textwrap.fill(f"winding temperature not examined: needs {needs}", 44, break_long_words=False)
        style = {"ha": "center", "va": "center", "fontsize": 9, "parse_math": False}
        axes.text(0.5, 0.5, text, transform=axes.transAxes, **style)
        axes.set_axis_off()
        return
    legend = _Legend(axes)
    windings = [curves.sizing.winding for curves in warm]
    taus = [winding.tau_th for winding in windings if isinstance(winding, Winding)]
    unit, factor = ("min", 1.0 / 60.0) if _TIME_CONSTANTS * max(taus) > 600.0 else ("s", 1.0)
    for curves in warm:
        rise, winding = curves.sizing.rise, curves.sizing.winding
        assert rise is not None and isinstance(winding, Winding)
        for name, time, values, dashes in _list_temperature_curves(curves.sizing, winding):
            style = {"color": curves.cycle, "linestyle": dashes, "linewidth": curves.width}
            legend.plot(curves.name(name), factor * time, values, **style)
        highest = float(rise.max())
        legend.line("permitted rise", winding.permitted_rise, color=curves.limit, linestyle="-.")
        for limit in (limit for limit in curves.sizing.limits if limit.name == "winding temperature"):
            y = highest + limit.limit - limit.used
            legend.line(f"{limit.source}, above the ambient", y, color=curves.limit, linestyle=":")
        legend.line("trip", winding.trip_rise, color=curves.lasting, linestyle="--")
        if len(drawn) == 1:
            legend.line("highest when warm", highest, color=GREY, linewidth=0.8, linestyle=":")
    legend.finish(f"time / {unit}", "temperature rise / K")
    axes.set_ylim(0.0, 1.05 * axes.get_ylim()[1])  # lines at the edge would be cut


def _list_temperature_curves(
    sizing: JointSizing, winding: Winding
) -> Iterator[tuple[str, np.ndarray, np.ndarray, str]]:
    """Yield name, times in s and rises in K, and style of the curves from cold."""
    cycle, rise, tau = sizing.cycle, np.asarray(sizing.rise), winding.tau_th
    count = max(int(np.ceil(_TIME_CONSTANTS * tau / cycle.duration)), 1)
    stride = max(count // _MAX_CYCLES, 1)
    # a cold motor differs from a warm one by what it began with, which decays
    start = float(rise[0])
    local = cycle.time - cycle.time[0]
    if stride == 1:
        part = _select_points(len(local))
        time = np.concatenate([local[part] + k * cycle.duration for k in range(count)])
        yield "from cold", time, np.tile(rise[part], count) - start * np.exp(-time / tau), "-"
        return
    cold = heat(cycle.time, winding.load(cycle), winding.permitted_rise, tau)
    k = np.arange(0, count, stride)
    start_rises = start * -np.expm1(-k * cycle.duration / tau)
    rows = [cold + b * np.exp(-local / tau) for b in start_rises]
    yield "highest of the cycle", k * cycle.duration, np.array([row.max() for row in rows]), "-"
    yield "lowest of the cycle", k * cycle.duration, np.array([row.min() for row in rows]), "--"


def _draw_power(axes: "Axes", drawn: list[_Curves]) -> None:
    from scipy.integrate import cumulative_trapezoid  # slow to import

    legend, right, kilo = _Legend(axes), axes.twinx(), 1e-3
    for curves in drawn:
        cycle, name = curves.sizing.cycle, curves.name("electrical power")
        part = _select_points(len(cycle.time))
        time = cycle.time[part] - cycle.time[0]
        legend.plot(name, time, kilo * cycle.P_el[part], color=curves.cycle, linewidth=curves.width)
        if len(drawn) == 1:
            shaft = kilo * (cycle.torque * cycle.omega)[part]
            legend.plot("mechanical power", time, shaft, color=curves.mean)
        energy = cumulative_trapezoid(cycle.P_el, cycle.time, initial=0.0)
        right.plot(time, kilo * energy[part], color=curves.cycle if curves.label else PURPLE, linestyle="--")
    legend.finish("time / s", "electrical power / kW" if len(drawn) > 1 else "power / kW")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    right.set_ylabel("electrical energy / kJ (dashed)", fontsize=9)
    right.tick_params(labelsize=8)
    right.spines[["top"]].set_visible(False)
    axes.set_zorder(right.get_zorder() + 1)  # the legend is above the energy
    axes.patch.set_visible(False)


class _Legend:
    """Draws curves into axes, and remembers the first one of each label for the legend."""

    def __init__(self, axes: "Axes") -> None:
        self._axes = axes
        self._entries: dict[str, Artist] = {}

    def plot(self, label: str, *data: object, **style: object) -> None:
        """Draw a curve."""
        (line,) = self._axes.plot(*data, **style)  # type: ignore[arg-type]
        self._entries.setdefault(label, line)

    def line(self, label: str, y: float, **style: object) -> None:
        """Draw a horizontal line."""
        self._entries.setdefault(label, self._axes.axhline(y, **style))  # type: ignore[arg-type]

    def finish(self, x: str, y: str, is_shown: bool = True) -> None:
        """Label the axes and add the legend."""
        tidy_axes(self._axes)
        if is_shown:
            texts = ["label"] * len(self._entries)
            legend = self._axes.legend(list(self._entries.values()), texts, fontsize=8, edgecolor="none")
            for text, label in zip(legend.get_texts(), self._entries, strict=True):
                text.set(text=label, parse_math=False)
        self._axes.set_xlabel(x, fontsize=9)
        self._axes.set_ylabel(y, fontsize=9)

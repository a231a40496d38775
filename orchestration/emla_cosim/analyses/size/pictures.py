"""Plots of a sizing: torque and force over speed, temperature over cycles, power and energy."""

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...study.actuator.entries import TURN
from ...views.plots.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, new_figure, tidy_axes
from .motor_curves import continuous_torque, peak_torque
from .result import JointSizing, SizeResult
from .thermal import heat
from .winding import Winding

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = 4000
"""Largest number of points of a drawn curve."""

_WARM = 5.0
"""Thermal time constants over which the temperature is drawn."""

_SHOWN_CYCLES = 40
"""Up to this number of cycles, each is drawn; of more, only the highest and the lowest temperature."""


def list_pictures(result: SizeResult) -> list[str]:
    """Return the names of the plots' files."""
    return [name_picture(joint) for joint in result.joints]


def draw_pictures(result: SizeResult) -> "Iterator[tuple[str, Figure]]":
    """Draw the plots of each joint with its first candidate that ran, by the names of their files."""
    for joint, sizing in result.joints.items():
        yield name_picture(joint), draw_joint(sizing)


def name_picture(joint: str) -> str:
    """Return the name of the file of a joint's plots."""
    return f"{''.join(c if c.isalnum() or c in '-_' else '_' for c in joint)}.png"


def draw_joint(sizing: JointSizing) -> "Figure":
    """Draw the four plots of a joint."""
    figure, axes = new_figure(2, 2, 4.6, 3.3, sharex="none")
    _draw_torque(axes[0, 0], sizing)
    _draw_force(axes[0, 1], sizing)
    _draw_temperature(axes[1, 0], sizing)
    _draw_power(axes[1, 1], sizing)
    title = f"{sizing.joint}: {sizing.actuator}"
    figure.suptitle(title if len(title) < 90 else f"{title[:87]}...", fontsize=11, parse_math=False)
    return figure


def _every(count: int) -> slice:
    return slice(None, None, max(count // _POINTS, 1))


def _draw_torque(axes: "Axes", sizing: JointSizing) -> None:
    cycle, rpm = sizing.cycle, 60.0 / TURN
    top = max(sizing.values["motor.n_max"], 1.05 * float(np.abs(cycle.omega).max()))
    speed = np.linspace(0.0, top, 200)
    inside = speed <= sizing.values["motor.n_max"]
    labels = ["peak torque", "cycle"]
    peak = np.where(inside, peak_torque(cycle.emla, speed), np.nan)
    axes.plot(rpm * speed, peak, color=RED)
    part = _every(len(cycle.time))
    shown = np.abs(cycle.omega[part]), np.abs(cycle.torque[part])
    axes.plot(rpm * shown[0], shown[1], color=BLUE, linewidth=1.0)
    row = int(np.abs(cycle.torque).argmax())  # thinned rows may lack it
    axes.plot([rpm * abs(cycle.omega[row])], [abs(cycle.torque[row])], "x", color=BLUE)
    labels.append("peak of the cycle")
    lasting = continuous_torque(sizing.values, speed)
    if lasting is not None:
        axes.plot(rpm * speed, np.where(inside, lasting, np.nan), color=ORANGE)
        labels.append("limit of the rms torque")
    axes.plot([rpm * cycle.rms(cycle.omega)], [sizing.figures.torque_rms_N_m], "o", color=GREEN)
    labels.append("rms of the cycle")
    _finish(axes, "motor speed / rpm", "motor torque / N m", labels)
    axes.set_ylim(bottom=0.0)


def _draw_force(axes: "Axes", sizing: JointSizing) -> None:
    """Draw axial force over speed.

    The curves are the motor's through gearbox and screw, without inertia; the lines are limits of the screw.
    """
    cycle = sizing.cycle
    ratio = cycle.emla.alpha_RL * cycle.emla.eta_GB
    top = max(cycle.emla.v_max, 1.05 * float(np.abs(cycle.v).max()))
    speed = np.linspace(0.0, top, 200)
    inside = speed <= cycle.emla.v_max
    omega = cycle.emla.alpha_RL * speed
    labels = ["force of the peak torque", "cycle"]
    peak = peak_torque(cycle.emla, omega) * ratio
    axes.plot(1e3 * speed, 1e-3 * np.where(inside, peak, np.nan), color=RED)
    part = _every(len(cycle.time))
    axes.plot(1e3 * np.abs(cycle.v[part]), 1e-3 * np.abs(cycle.force[part]), color=BLUE, linewidth=1.0)
    lasting = continuous_torque(sizing.values, omega)
    if lasting is not None:
        axes.plot(1e3 * speed, 1e-3 * np.where(inside, lasting * ratio, np.nan), color=ORANGE)
        labels.append("force of the continuous torque")
    for name, style in (("axial force", "--"), ("screw static load", ":")):
        for limit in (one.limit for one in sizing.limits if one.name == name):
            axes.axhline(limit, color=RED, linestyle=style)
            labels.append(f"limit of the {name}")
    _finish(axes, "speed / mm/s", "axial force / kN", labels)
    axes.set_ylim(bottom=0.0)


def _draw_temperature(axes: "Axes", sizing: JointSizing) -> None:
    cycle = sizing.cycle
    winding = sizing.winding
    if sizing.rise is None or not isinstance(winding, Winding):
        text = textwrap.fill(f"winding temperature not examined: needs {winding}", 44, break_long_words=False)
        axes.text(
            *(0.5, 0.5, text),
            ha="center",
            va="center",
            transform=axes.transAxes,
            fontsize=9,
            parse_math=False,
        )
        axes.set_axis_off()
        return
    tau = winding.tau_th
    count = max(int(np.ceil(_WARM * tau / cycle.duration)), 1)
    every = max(count // _SHOWN_CYCLES, 1)
    unit, factor = ("min", 1.0 / 60.0) if _WARM * tau > 600.0 else ("s", 1.0)
    # a cold motor differs from a warm one by what it began with, which decays
    start = float(sizing.rise[0])
    local = cycle.time - cycle.time[0]
    cold = heat(cycle.time, winding.load(cycle), winding.permitted_rise, tau)
    part = _every(len(local))
    labels = []
    if every == 1:
        rows = [
            (
                local[part] + k * cycle.duration,
                sizing.rise[part] - start * np.exp(-(local[part] + k * cycle.duration) / tau),
            )
            for k in range(count)
        ]
        axes.plot(
            factor * np.concatenate([t for t, _ in rows]), np.concatenate([r for _, r in rows]), color=BLUE
        )
        labels.append("from cold")
    else:
        k = np.arange(0, count, every)
        begin = start * -np.expm1(-k * cycle.duration / tau)
        highest = [float((cold + b * np.exp(-local / tau)).max()) for b in begin]
        lowest = [float((cold + b * np.exp(-local / tau)).min()) for b in begin]
        axes.plot(factor * k * cycle.duration, highest, color=BLUE)
        axes.plot(factor * k * cycle.duration, lowest, color=BLUE, linestyle="--")
        labels += ["highest of the cycle", "lowest of the cycle"]
    highest_rise = float(sizing.rise.max())
    axes.axhline(winding.permitted_rise, color=RED)
    labels.append("permitted rise")
    for limit in (one for one in sizing.limits if one.name == "winding temperature"):
        axes.axhline(highest_rise + limit.limit - limit.used, color=RED, linestyle=":")
        labels.append(f"{limit.source}, above the ambient")
    axes.axhline(winding.trip_rise, color=ORANGE, linestyle="--")
    axes.axhline(highest_rise, color=GREY, linewidth=0.8, linestyle=":")
    labels += ["trip", "highest when warm"]
    _finish(axes, f"time / {unit}", "temperature rise / K", labels)
    axes.set_ylim(0.0, 1.05 * axes.get_ylim()[1])  # lines at the edge would be cut


def _draw_power(axes: "Axes", sizing: JointSizing) -> None:
    cycle = sizing.cycle
    part = _every(len(cycle.time))
    time, kilo = cycle.time[part] - cycle.time[0], 1e-3
    axes.plot(time, kilo * cycle.P_el[part], color=BLUE)
    axes.plot(time, kilo * (cycle.torque * cycle.omega)[part], color=GREEN)
    _finish(axes, "time / s", "power / kW", ["electrical power", "mechanical power"])
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    steps = np.diff(cycle.time)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (cycle.P_el[1:] + cycle.P_el[:-1]) * steps)])
    right = axes.twinx()
    right.plot(time, kilo * energy[part], color=PURPLE, linestyle="--")
    right.set_ylabel("electrical energy / kJ (dashed)", fontsize=9)
    right.tick_params(labelsize=8)
    right.spines[["top"]].set_visible(False)
    axes.set_zorder(right.get_zorder() + 1)  # the legend is above the energy
    axes.patch.set_visible(False)


def _finish(axes: "Axes", x: str, y: str, labels: list[str]) -> None:
    tidy_axes(axes, labels)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)

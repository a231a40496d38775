"""Draw images/study-robustness.png and print the tables of sweeps-results.md.

    emla sweep study-robustness --output FOLDER
    python docs/robustness.py FOLDER

`python docs/robustness.py --tilt FOLDER` sweeps tilt alone into a folder. It prints Sobol indices of whether
tilt is held.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import emla_cosim as ec
from emla_cosim.analyses.sweep.columns import figure_values, influence, read_factor
from emla_cosim.analyses.sweep.plan import load_plan
from emla_cosim.base.arrays import Vector
from emla_cosim.study.registration import register
from emla_cosim.study.systems import STUDY
from emla_cosim.views.plots.style import BLUE, GREY, ORANGE, RED, save, tidy_axes

HERE = Path(__file__).parent

HELD, LOST, LATE = "held", "settled, but not held", "not settled"
COLORS = {HELD: BLUE, LOST: ORANGE, LATE: RED}
SHOWN = {
    "position error / µm": ("position_error_m", 1e6),
    "speed error / (mm/s)": ("velocity_error_m_s", 1e3),
    "torque peak / (N m)": ("torque_peak_N_m", 1.0),
    "settling time / ms": ("settling_time_s", 1e3),
}
BASE_SAMPLES = 512


class Joint:
    """One joint in all variants."""

    def __init__(self, result: ec.SweepResult, name: str) -> None:
        self._result, self.name = result, name
        settled = ~np.isnan(self.figure("settling_time_s"))
        ended = np.where(settled, LOST, LATE)
        self.outcomes = np.where(self.figure("held") == 1.0, HELD, ended)
        study = STUDY[name]
        away = np.sign(study.start.x_L - study.reference.q_S)
        self.start_mm = 1e3 * away * (read_factor(result, f"{name}.start").values - study.reference.q_S)
        self.speed = self.figure("speed_peak_m_s") / study.emla.v_max

    def figure(self, name: str) -> Vector:
        """Return one of its figures for each variant."""
        return figure_values(self._result, f"{self.name}.{name}")

    def of_held(self, name: str) -> Vector:
        """Return the same, with NaN for variants that are not held."""
        return np.where(self.outcomes == HELD, self.figure(name), np.nan)

    def followed(self, values: Vector, count: int) -> list[tuple[str, float]]:
        """Return the factors with the largest rank correlation with values."""
        names = [n for n in self._result.factors if n.startswith(f"{self.name}.")]
        found = [(n.partition(".")[2], influence(read_factor(self._result, n), values)) for n in names]
        return sorted(found, key=lambda one: -one[1])[:count]


def draw(joints: Sequence[Joint], path: Path) -> None:
    """Draw the approach speed of each joint against its start, and the factors of its position error."""
    figure = Figure(figsize=(10.5, 5.8), dpi=100, layout="constrained")
    grid = figure.subplots(2, 3)
    for joint, (above, below) in zip(joints, grid.T, strict=True):
        draw_approach(joint, above)
        draw_followed(joint, below)
    grid[0, 0].set_ylabel("largest speed / its limit", fontsize=9)
    grid[1, 1].set_xlabel("rank correlation with the position error, if held", fontsize=9)
    handles, labels = max((axes.get_legend_handles_labels() for axes in grid[0]), key=lambda x: len(x[1]))
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    with path.open("wb") as stream:
        save(figure, stream)


def draw_approach(joint: Joint, axes: Axes) -> None:
    """Draw the largest speed against the distance at the start."""
    for outcome, color in COLORS.items():
        mine = joint.outcomes == outcome
        if mine.any():
            axes.scatter(
                joint.start_mm[mine], joint.speed[mine], s=4, color=color, linewidths=0, label=outcome
            )
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set_title(f"{joint.name}: {(joint.outcomes == HELD).mean():.1%} held", fontsize=10)
    axes.set_xlabel("start behind the reference / mm", fontsize=9)
    tidy_axes(axes)
    axes.set_ylim(bottom=0.0)


def draw_followed(joint: Joint, axes: Axes) -> None:
    """Draw the factors that correlate with the position error, for variants that are held."""
    found = joint.followed(joint.of_held("position_error_m"), 6)[::-1]
    axes.barh([name for name, _ in found], [value for _, value in found], color=BLUE)
    axes.set_xlim(0.0, 1.0)
    tidy_axes(axes)


def lines(joints: Sequence[Joint]) -> Iterable[str]:
    """Yield the lines of the tables."""
    yield "| | " + " | ".join(joint.name for joint in joints) + " |"
    yield "|---|" + "---|" * len(joints)
    for outcome in COLORS:
        yield f"| {outcome} | " + " | ".join(f"{(j.outcomes == outcome).sum()}" for j in joints) + " |"
    for label, (name, scale) in SHOWN.items():
        cells = []
        for joint in joints:
            values = scale * joint.of_held(name)
            cells.append(" / ".join(f"{v:.3g}" for v in np.nanpercentile(values, [50, 95, 100])))
        yield f"| {label} | " + " | ".join(cells) + " |"
    for name in ("held", "position_error_m", "velocity_error_m_s", "torque_peak_N_m"):
        for joint in joints:
            values = joint.figure(name) if name == "held" else joint.of_held(name)
            yield f"{joint.name} {name}: " + ", ".join(f"{n} {v:.2f}" for n, v in joint.followed(values, 4))


def sweep_tilt(folder: Path) -> None:
    """Run the factors of tilt alone as a Saltelli sample."""
    register()
    plan = load_plan("study-robustness")
    vary = {n: d for n, d in plan.vary.items() if n.startswith(("*.", "tilt."))}
    set_ = {n: v for n, v in plan.options.get("set", {}).items() if n.startswith("tilt.")}
    alone = replace(
        plan,
        scenario="tilt",
        vary=vary,
        sampling="saltelli",
        runs=BASE_SAMPLES,
        metrics=["tilt.held", "tilt.position_error_m"],
        signals=[],
        options={**plan.options, "set": set_},
    )
    ec.sweep(alone, output=folder, progress=ec.BarProgress())


def main(arguments: Sequence[str]) -> None:
    """Draw and print, or with `--tilt FOLDER` run the sweep of tilt."""
    if arguments[0] == "--tilt":
        sweep_tilt(Path(arguments[1]))
        found = ec.read_sweep(arguments[1]).sobol("tilt.held")
        for i in np.argsort(-found.total):
            print(
                f"| {found.factors[i]} | {found.first[i]:.2f} ± {found.first_confidence[i]:.2f} "
                f"| {found.total[i]:.2f} ± {found.total_confidence[i]:.2f} |"
            )
        return
    result = ec.read_sweep(arguments[0])
    joints = [Joint(result, name) for name in STUDY]
    draw(joints, HERE / "images/study-robustness.png")
    print("\n".join(lines(joints)))


if __name__ == "__main__":
    main(sys.argv[1:])

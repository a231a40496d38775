"""Draw images/faults.png: the coupled manipulator with the gains `damped` and each fault in mid-motion."""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import emla_cosim as ec
from emla_cosim.study.roles import find_variable
from emla_cosim.study.systems import STUDY as JOINTS

HERE = Path(__file__).parent

AT = 20.0
FAULTS = {
    "payload dropped": f"machine.manipulator.payload.m=constant:0@{AT:g}",
    "payload doubled": f"machine.manipulator.payload.m=gain:2@{AT:g}",
    "lift without power": f"lift.plant.supply.sag=constant:1@{AT:g}",
    "tilt without power": f"tilt.plant.supply.sag=constant:1@{AT:g}",
    "telescope without power": f"telescope.plant.supply.sag=constant:1@{AT:g}",
}
STEP, WINDOW = 2e-3, 50
"""Time between rows in s, and number of rows for one point of the curve."""
COLORS = ("#2f6db3", "#d9822b", "#4a9c6d")


def run(fault: str, folder: Path) -> ec.Result:
    """Run the whole trajectory with this fault."""
    scenario = ec.load("hdrm-coupled", gains="damped", fault=[ec.Fault.of_text(fault)], fmus=folder)
    with scenario.prepare(output_interval=STEP) as simulation:
        return simulation.attempt()


def signal(result: ec.Result, joint: str, role: str) -> np.ndarray:
    """Return the signal of a role."""
    return np.asarray(result[str(find_variable(joint, role, result.names))])


def envelope(result: ec.Result, joint: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles of windows of 0.1 s, and the largest position error in m in each."""
    error = np.abs(signal(result, joint, "x_L") - signal(result, joint, "x_d"))
    whole = len(error) // WINDOW * WINDOW
    windows = error[:whole].reshape(-1, WINDOW).max(axis=1)
    return np.asarray(result.time)[WINDOW // 2 : whole : WINDOW], windows


def summary(result: ec.Result) -> str:
    """Return largest errors and torques after the fault, the final position of each joint, and remarks."""
    after = result.time >= AT
    parts = []
    for joint in JOINTS:
        error = np.abs(signal(result, joint, "x_L") - signal(result, joint, "x_d"))
        torque = np.abs(signal(result, joint, "tau_m"))
        v = np.abs(signal(result, joint, "v_L"))
        parts.append(
            f"{joint} {1e6 * error[after].max():.3g} um (end {1e6 * error[-1]:.3g}),"
            f" {torque[after].max():.3g} N m, {v[after].max():.3g} m/s,"
            f" at {signal(result, joint, 'x_L')[-1]:.4g} m"
        )
    return "\n  ".join([*parts, *result.remarks, result.problem or f"whole, {result.end_s:g} s"])


def main() -> None:
    """Run, print the numbers, draw."""
    figure = Figure(figsize=(11.0, 3.4), dpi=150, layout="constrained")
    grid = figure.subplots(1, len(FAULTS), sharey=True, sharex=True)
    with tempfile.TemporaryDirectory() as folder:
        for axes, (label, fault) in zip(grid, FAULTS.items(), strict=True):
            result = run(fault, Path(folder))
            print(f"{label}\n  {summary(result)}", flush=True)
            for joint, color in zip(JOINTS, COLORS, strict=True):
                time, error = envelope(result, joint)
                axes.plot(time, 1e3 * error, color=color, linewidth=1.0, label=joint)
            axes.axvline(AT, color="black", linewidth=0.7, linestyle=":")
            axes.set_title(label, fontsize=9, loc="left")
            axes.set_xlabel("time / s")
            axes.set_yscale("log")
            axes.set_ylim(5e-5, 2e3)
            axes.grid(alpha=0.25)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=8)
    grid[0].set_ylabel("position error / mm")
    grid[-1].legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    FigureCanvasAgg(figure).print_png(HERE / "images" / "faults.png")


if __name__ == "__main__":
    main()

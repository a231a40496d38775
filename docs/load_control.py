"""Measure loads that are not rigid, with and without control of the load, for load-control.md.

    python docs/load_control.py [SECTION ...]

Sections are `seeds`, `corners`, `causes`, `margins`, `booms` and `draw`, which draws images/load-control.png.
Without any, all are done, in about a quarter of an hour. load-control.csv has
all tables; the page shows some.
"""

import csv
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import emla_cosim as ec
from emla_cosim.analyses.variants.sampling import draw_seeds
from emla_cosim.base.arrays import Vector
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.systems import STUDY
from emla_cosim.views.plots.style import BLUE, GREY, ORANGE, save, tidy_axes
from emla_fmu.reference import quintic_duration

HERE = Path(__file__).parent
TABLE = HERE / "load-control.csv"

CONTROLS = ("none", "motor", "sensor")
ENTROPY, SEEDS, FEW = 20590, 20, 3
"""What all seeds of all runs are drawn from, and the number of runs: of the scenario, and of other cases."""
CORNERS = ((0.7, 1.0), (1.3, 1.0), (1.0, 0.5), (1.0, 1.5), (0.7, 0.5), (0.7, 1.5), (1.3, 0.5), (1.3, 1.5))
"""Stiffness and mass of the plant's load, relative to those of the model."""
_STEP_AT = 3.0
"""Time of a load step in s."""
RANDOM = ("plant.sensor.seed", "plant.sensor.current.seed", "plant.load.sensor.seed", "disturbance.d_2.seed")

Values = dict[str, Any]
Setting = Callable[[str], Values]
"""Returns values for a joint, by name without the joint."""


def for_each(setting: Setting, joints: Iterable[str] = STUDY) -> Values:
    """Return values by full name from those of each joint."""
    return {f"{joint}.{name}": value for joint in joints for name, value in setting(joint).items()}


def seeds(run: int) -> Values:
    """Return the seeds of all random sequences for a run."""
    drawn = iter(draw_seeds([ENTROPY, run], len(STUDY) * len(RANDOM)))
    return for_each(lambda _: {name: next(drawn) for name in RANDOM})


def corner(joint: str, stiffness: float, mass: float) -> Values:
    """Return a load that differs from its model by factors, and rests on its spring at the start."""
    file = load_joint(joint)
    force = file.load.parameters()["level"][0]
    nominal = file.compliant_load.parameters(force)
    play = math.copysign(0.5 * nominal["backlash"], force)
    return {
        "plant.transmission.stiffness": nominal["stiffness"] * stiffness,
        "plant.transmission.damping": nominal["damping"] * math.sqrt(stiffness * mass),
        "plant.load.m": nominal["m_load"] * mass,
        "plant.start.deflection": force / (nominal["stiffness"] * stiffness) + play,
    }


def assumed_force(factor: float) -> Setting:
    """Return a command that assumes another load force."""
    return lambda joint: {"command.F_hat": load_joint(joint).load.parameters()["level"][0] * factor}


def start(distance: float) -> Setting:
    """Return a start behind the reference by a distance in m."""

    def values(joint: str) -> Values:
        reference = load_joint(joint).reference
        x = reference.q_S - math.copysign(distance, reference.q_E - reference.q_S)
        return {"plant.start.x_L": x, "observer.start.x_hat": x}

    return values


def load_step(joint: str) -> Values:
    """Return a load force that grows by 10 % at 3 s."""
    force = load_joint(joint).load.parameters()["level"][0]
    return {
        "disturbance.load.level": [force, *[1.1 * force] * 5],
        "disturbance.load.start": [0.0, _STEP_AT, *[1e9] * 4],
        "disturbance.load.ramp": 1e-3,
    }


def constant(**values: float) -> Setting:
    """Return the same values for each joint; `__` stands for a dot."""
    return lambda _: {name.replace("__", "."): value for name, value in values.items()}


class Study:
    """`study-compliant` with one load control, prepared once; what is set is that of some of its joints."""

    def __init__(self, control: str, joints: Iterable[str] = STUDY, **options: Any) -> None:
        self._joints = joints
        self._simulation = ec.load("study-compliant", load_control=control, **options).prepare()

    def __enter__(self) -> "Study":
        return self

    def __exit__(self, *_: object) -> None:
        self._simulation.close()

    def measure(self, setting: Setting = lambda _: {}, runs: int = 1, **options: Any) -> list[Any]:
        """Return the metrics of runs with different seeds."""
        return [self.run(setting, run, **options).metrics for run in range(runs)]

    def run(self, setting: Setting = lambda _: {}, run: int = 0, **options: Any) -> ec.Result:
        """Return the result of a run."""
        return self._simulation.attempt(set={**for_each(setting, self._joints), **seeds(run)}, **options)

    def errors(self, setting: Setting = lambda _: {}, **options: Any) -> list[str]:
        """Return the mean load error of each joint in um, and whether it is held in all runs."""
        metrics = self.measure(setting, FEW, **options)
        cells = []
        for joint in STUDY:
            error = figures(metrics, joint, "load_position_error_m").mean()
            is_held = all(m["joints"][joint]["held"] for m in metrics)
            cells.append(f"{error:.3g}" + ("" if is_held else ", not held"))
        return cells


def figures(metrics: Sequence[Any], joint: str, name: str, scale: float = 1e6) -> Vector:
    """Return a figure of a joint's load in each run."""
    return scale * np.array([m["loads"][joint][name] for m in metrics])


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table in Markdown while its rows are computed, and put them into the CSV file."""
    print(f"\n| {title} | " + " | ".join(columns) + " |")
    print("|---|" + "---:|" * len(columns))
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)
        keep_cells({(title, row[0], column): cell for column, cell in zip(columns, row[1:], strict=True)})


def keep_cells(cells: Mapping[tuple[str, ...], str]) -> None:
    """Put cells into the CSV file, by table, row and column."""
    with TABLE.open(encoding="utf-8", newline="") as stream:
        header, *lines = csv.reader(stream)
    kept = {tuple(line[:3]): line[3] for line in lines} | dict(cells)
    with TABLE.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([*labels, value] for labels, value in kept.items())


def print_seeds() -> None:
    """Print load error, swing and settling time with random seeds."""
    for control in CONTROLS:
        with Study(control) as study:
            metrics = study.measure(runs=SEEDS)
        rows = []
        for label, name, scale in (
            ("load error / µm", "load_position_error_m", 1e6),
            ("swing / µm", "load_swing_m", 1e6),
            ("load settling time / ms", "load_settling_time_s", 1e3),
        ):
            values = [figures(metrics, joint, name, scale) for joint in STUDY]
            cells = [f"{x.mean():.3g} ± {x.std(ddof=1):.2g}, {x.max():.3g}" for x in values]
            rows.append([label, *cells])
        peaks = [max(m["joints"][joint]["torque_peak_N_m"] for m in metrics) for joint in STUDY]
        rows.append(["torque peak / (N m), worst", *(f"{x:.3g}" for x in peaks)])
        held = [sum(m["joints"][joint]["held"] for m in metrics) for joint in STUDY]
        rows.append(["held", *(f"{n} of {SEEDS}" for n in held)])
        print_table(f"{control}: mean ± standard deviation, worst", list(STUDY), rows)


def print_corners() -> None:
    """Print load errors for a load that is not the model's."""
    for control in CONTROLS:
        with Study(control) as study:
            rows = [
                [f"{k:.0%} stiffness, {m:.0%} mass", *study.errors(lambda j, k=k, m=m: corner(j, k, m))]
                for k, m in CORNERS
            ]
        print_table(f"{control}: load error / µm", list(STUDY), rows)


CAUSES: Mapping[str, tuple[Setting, Sequence[str]]] = {
    "as it is": (constant(), CONTROLS),
    "assumed load force 10 % too high": (assumed_force(1.1), ["motor"]),
    "assumed load force 40 % too high": (assumed_force(1.4), ["motor"]),
    "assumed load force 40 % too low": (assumed_force(0.6), ["motor"]),
    "start 14 mm behind": (start(0.014), CONTROLS),
    "start 50 mm behind": (start(0.05), CONTROLS),
    "load step of 10 %": (load_step, CONTROLS),
    "load sensor: noise 10 µm, steps 10 µm": (
        constant(plant__load__sensor__sigma=1e-5, plant__load__sensor__resolution=1e-5),
        ["sensor"],
    ),
    "encoder: noise 1 µm": (constant(plant__sensor__sigma=1e-6), CONTROLS),
    "delay of 2 samples": (constant(plant__inverter__delay=2e-4), CONTROLS),
}
"""What differs from the scenario, and for which load controls, by label."""

AT: Mapping[str, float] = {"lift": 0.7, "tilt": 0.6, "telescope": 0.7}
"""A time in motion, in s."""
DURATION = {"position": 0.4, "load": 0.6, "current": 0.2}
"""Length of a response in s."""
AMPLITUDES = (1e-7, 1e-6, 1e-8, 3e-6)
"""Heights of pulses of the measured position in m: the first with which the loop is linear counts."""

BOOMS = {"12 t on 20 kN/mm": (12e3, 20e6), "5 t on 2 kN/mm": (5e3, 2e6)}
BOOM_JOINTS = ("lift", "tilt")
PERIODS = 3.0
"""Duration of the planned start in periods of the boom, as the joints of the study have it."""
METHODS: Mapping[str, tuple[str, bool, int, float]] = {
    "no control": ("none", False, 0, 0.0),
    "notch alone": ("none", True, 0, 0.0),
    "motor": ("motor", False, 0, PERIODS),
    "motor, ZV": ("motor", False, 2, PERIODS),
    "motor, ZVD": ("motor", False, 3, PERIODS),
    "motor, notch": ("motor", True, 0, PERIODS),
    "motor, notch, longer start": ("motor", True, 0, 1.5 * PERIODS),
}
"""Load control, whether there is a notch, pulses of a shaper, and periods of the planned start, by label."""


def print_causes() -> None:
    """Print load errors for wrong forces, other starts, noise and load steps, and of all controllers."""
    for control in CONTROLS:
        labels = [label for label in CAUSES if control in CAUSES[label][1]]
        with Study(control) as study:
            rows = [[label, *study.errors(CAUSES[label][0])] for label in labels]
            rows.append(["half the step size", *study.errors(step_size=5e-5)])
        print_table(f"{control}: load error / µm", list(STUDY), rows)
    rows = []
    for controller in ("rsba", "foc", "cac", "anatc"):
        for control in CONTROLS:
            with Study(control, controller=controller, gains="compliant") as study:
                rows.append([f"{controller}, {control}", *study.errors()])
    print_table("load error / µm", list(STUDY), rows)


def print_margins() -> None:
    """Print the margins of all loops in motion, of the model's load and the smallest of all loads."""
    loops = [(control, "position") for control in CONTROLS]
    loops += [("sensor", "load"), *((control, "current") for control in CONTROLS)]
    for title, cases in (("load of the model", [(1.0, 1.0)]), ("smallest of other loads", CORNERS)):
        rows = [
            [
                f"{control}: {loop} loop",
                *(describe([margins(control, loop, j, *c) for c in cases]) for j in STUDY),
            ]
            for control, loop in loops
        ]
        print_table(title, list(STUDY), rows)


def margins(control: str, loop: str, joint: str, stiffness: float, mass: float) -> ec.Margins:
    """Return the margins of a loop in motion."""
    opened = {
        "position": joint,
        "load": f"{joint}.plant.load.x_measured->{joint}.load_observer.y",
        "current": f"{joint}.controller.u_q->{joint}.plant.u_q",
    }[loop]
    quiet = {"plant.load.sensor.sigma": 0.0, "plant.load.sensor.resolution": 0.0}
    problem: ec.RunError | None = None
    for amplitude in AMPLITUDES if loop == "position" else (None,):
        try:
            result = ec.linearize(
                "study-compliant",
                load_control=control,
                open=opened,
                at=AT[joint],
                duration=DURATION[loop],
                stop_time=AT[joint] + DURATION[loop] + 0.1,
                amplitude=amplitude,
                set=for_each(lambda name: {**corner(name, stiffness, mass), **quiet}),
                plots=False,
            )
        except ec.RunError as error:
            problem = error
        else:
            return next(iter(result.margins.values()))
    assert problem is not None
    raise problem


def describe(margins: Sequence[ec.Margins]) -> str:
    """Return the smallest margins, and the largest Ms."""
    phase = min(m.phase_deg for m in margins)
    up, down = min(m.gain_up_dB for m in margins), max(m.gain_down_dB for m in margins)
    text = [f"{phase:.1f}°" if math.isfinite(phase) else "none", f"+{up:.1f}"]
    text[1] += f"/{down:.1f} dB" if math.isfinite(down) else " dB"
    return ", ".join((*text, f"{max(m.Ms for m in margins):.2f}"))


def boom_command(mass: float, stiffness: float, periods: float) -> Values:
    """Return what a command knows of a boom, and its planned start of some periods."""
    return {
        "command.model.stiffness": stiffness,
        "command.model.m_load": mass,
        "command.approach.duration": periods * 2.0 * math.pi * math.sqrt(mass / stiffness),
    }


def boom(mass: float, stiffness: float) -> Setting:
    """Return a plant with a boom of damping 0.02 that rests on its spring."""

    def values(joint: str) -> Values:
        force = load_joint(joint).load.parameters()["level"][0]
        play = math.copysign(0.5 * load_joint(joint).compliant_load.backlash, force)
        return {
            "plant.transmission.stiffness": stiffness,
            "plant.transmission.damping": 0.04 * math.sqrt(stiffness * mass),
            "plant.load.m": mass,
            "plant.start.deflection": force / stiffness + play,
        }

    return values


def shaped(frequency: float, pulses: int) -> ec.Input:
    """Return the motions of lift and tilt, convolved with the pulses of a ZV (2) or ZVD (3) shaper."""
    zeta = 0.02
    ratio = math.exp(-zeta * math.pi / math.sqrt(1.0 - zeta * zeta))
    weights = np.poly([-ratio] * (pulses - 1))
    half = 0.5 / (frequency * math.sqrt(1.0 - zeta * zeta))
    time = np.arange(0.0, 3.0, 1e-4)
    columns, signals = {"time": time}, {}
    for joint in BOOM_JOINTS:
        reference = load_joint(joint).reference
        distance = reference.q_E - reference.q_S
        T = quintic_duration(distance, reference.peak)
        total = np.zeros((3, len(time)))
        for i, weight in enumerate(weights / weights.sum()):
            r = np.clip((time - i * half) / T, 0.0, 1.0)
            x = r**3 * (10.0 - 15.0 * r + 6.0 * r * r)
            v, a = 30.0 * (r * (1.0 - r)) ** 2 / T, 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) / T**2
            total += weight * distance * np.array([x, v, a])
        total[0] += reference.q_S
        for name, values in zip(("x_d", "v_d", "a_d"), total, strict=True):
            columns[f"{joint}_{name}"] = values
            signals[f"{joint}.reference.{name}"] = f"{joint}_{name}"
    return ec.Input(data=columns, signals=signals)


def swing(result: ec.Result, joint: str, frequency: float) -> float:
    """Return the swing of a deflection in um, peak to peak, in two periods after the commanded motion."""
    time = np.asarray(result.time)
    names = (f"{joint}.command.x_c", f"{joint}.reference.x_d")
    x = result[next(name for name in names if name in result.names)]
    end = time[np.flatnonzero(np.abs(x - x[-1]) > 1e-6)[-1]]
    deflection = result[f"{joint}.plant.transmission.deflection"]
    return 1e6 * float(np.ptp(deflection[(time > end) & (time < end + 2.0 / frequency)]))


def print_booms() -> None:
    """Print swings of booms after the move, with and without control, notches and shapers."""
    swings: dict[tuple[str, str], dict[str, list[float]]] = {}
    for label, (mass, stiffness) in BOOMS.items():
        frequency = math.sqrt(stiffness / mass) / (2.0 * math.pi)
        for method, (control, has_notch, pulses, periods) in METHODS.items():
            options: Values = {"notch": dict.fromkeys(BOOM_JOINTS, frequency)} if has_notch else {}
            if pulses:
                options["input"] = [shaped(frequency, pulses)]
            by_joint = swings[label, method] = {joint: [] for joint in BOOM_JOINTS}
            with Study(control, joints=BOOM_JOINTS, **options) as study:
                for k, m in ((1.0, 1.0), *CORNERS):
                    plant = boom(mass * m, stiffness * k)
                    known = {} if control == "none" else boom_command(mass, stiffness, periods)
                    result = study.run(lambda j, p=plant, c=known: {**p(j), **c}, stop_time=5.0)
                    for joint in BOOM_JOINTS:
                        by_joint[joint].append(swing(result, joint, frequency))
    columns = [(label, joint) for label in BOOMS for joint in BOOM_JOINTS]
    for title, part in (
        ("boom of the model", slice(0, 1)),
        ("stiffness or mass wrong", slice(1, 5)),
        ("both wrong", slice(5, 9)),
    ):
        rows = []
        for method in METHODS:
            cells = []
            for label, joint in columns:
                now, before = (swings[label, m][joint][part] for m in (method, "no control"))
                share = max(a / b for a, b in zip(now, before, strict=True))
                cells.append(f"{max(now):.3g} ({share:.2g})")
            rows.append([method, *cells])
        print_table(f"{title}: swing / µm", [f"{label}, {joint}" for label, joint in columns], rows)


def draw() -> None:
    """Draw the load error of lift, and the deflection of a boom on it."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for control, color in zip(CONTROLS, (GREY, BLUE, ORANGE), strict=True):
        with Study(control) as study:
            result = study.run(stop_time=2.0)
        error = 1e6 * (result["lift.plant.load.x"] - result["lift.reference.x_d"])
        left.plot(result.time, error, color=color, label=f"--load-control {control}", linewidth=1.0)
    left.set_ylim(-1000.0, 1000.0)
    left.set_title("lift: load error / µm", fontsize=10)
    mass, stiffness = next(iter(BOOMS.values()))
    frequency = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    methods = {"no control": GREY, "motor": BLUE, "motor, notch": ORANGE}
    for method, color in methods.items():
        control, has_notch, _, periods = METHODS[method]
        options = {"notch": {"lift": frequency}} if has_notch else {}
        known = {} if control == "none" else boom_command(mass, stiffness, periods)
        plant = boom(0.5 * mass, stiffness)
        with Study(control, joints=("lift",), **options) as study:
            result = study.run(lambda j, p=plant, c=known: {**p(j), **c}, stop_time=2.0)
        deflection = 1e3 * result["lift.plant.transmission.deflection"]
        right.plot(result.time, deflection, color=color, label=method, linewidth=1.0)
    right.set_title("boom of 6 t, 12 t assumed: deflection / mm", fontsize=10)
    for axes in (left, right):
        tidy_axes(axes)
        axes.set_xlabel("time / s", fontsize=9)
        axes.legend(frameon=False, fontsize=8)
    with (HERE / "images/load-control.png").open("wb") as stream:
        save(figure, stream)


if __name__ == "__main__":
    sections: Mapping[str, Callable[[], None]] = {
        "seeds": print_seeds,
        "corners": print_corners,
        "causes": print_causes,
        "margins": print_margins,
        "booms": print_booms,
        "draw": draw,
    }
    for section in sys.argv[1:] or sections:
        sections[section]()

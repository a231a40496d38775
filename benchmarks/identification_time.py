"""How long `emla identify` takes for 10 parameters and 3 experiments of 10 s in steps of 0.1 ms.

    python -m benchmarks.identification_time --workers 1 2 --rounds 3

A simulated machine of the joint `prototype` moves there and back three times: slowly, fast, and fast with
half the load. The plant alone is identified from its recorded voltages and load.
"""

import argparse
import dataclasses
import statistics
import sys
import time
from typing import Any

import numpy as np

import emla_cosim as ec

from .identification import BITS, INPUTS, STEP, STEPS_PER_ROW

STOP = 10.0
"""Length of an experiment in s."""

TRUE = {
    "motor.R_s": 0.09,
    "motor.L_d": 2.3e-3,
    "motor.L_q": 2.6e-3,
    "motor.Phi_PM": 0.18,
    "motor.J_m": 0.0075,
    "motor.B_m": 2.5e-3,
    "friction.F_C": 350.0,
}
"""Parameters of the machine."""

RANGES: dict[str, Any] = {
    **{f"prototype.plant.{name}": f"{0.3 * value!r}:{3.0 * value!r}" for name, value in TRUE.items()},
    "offset(prototype.plant.x_L)": "-1 mm:1 mm",
    "offset(prototype.plant.i_q)": "-1 A:1 A",
    "delay(prototype.plant.x_L)": "0 ms:3 ms",
}

EXPERIMENTS = {"slow": (4.0, 20e3), "fast": (1.0, 20e3), "half the load": (1.0, 10e3)}
"""Duration of a move in s, and load in N."""


def measure(duration: float, load: float, seed: int) -> tuple[ec.Input, ec.Input]:
    """Return the recorded inputs of a machine, and what was measured of it: position and current."""
    more: dict[str, Any] = {
        "reference.waypoint": [0.05, 0.1, 0.05],
        "reference.move.start": [0.0, 5.0],
        "reference.move.duration": [duration, duration],
        "disturbance.load.level[1]": load,
        "plant.start.x_L": 0.05,
        "plant.sensor.current.sigma": 0.2,
        "plant.sensor.current.seed": seed,
    }
    true_values = {f"prototype.plant.{name}": value for name, value in TRUE.items()}
    true_values |= {f"prototype.{name}": value for name, value in more.items()}
    run = ec.load("prototype", stop_time=STOP, output_interval=STEP, set=true_values).prepare().run()
    sources = {name: "controller" if name in ("u_q", "u_d") else "disturbance" for name in INPUTS}
    driven = {name: run[f"prototype.{of}.{name}"] for name, of in sources.items()}
    signals = {f"prototype.plant.{name}": ec.Column(name) for name in INPUTS}
    inputs = ec.Input(data={"time": run.time, **driven}, signals=signals, interpolation="held")
    resolution = 0.016 / 7.7 / 2**BITS
    x = resolution * np.round(np.interp(run.time - 1e-3, run.time, run["prototype.plant.x_L"]) / resolution)
    columns = {"time": run.time, "x": x, "i_q": run["prototype.plant.i_q_measured"]}
    names = {f"prototype.plant.{name}": ec.Column(column) for name, column in (("x_L", "x"), ("i_q", "i_q"))}
    data = {name: column[STEPS_PER_ROW::STEPS_PER_ROW] for name, column in columns.items()}
    return inputs, ec.Input(data=data, signals=names)


def main() -> int:
    """Identify with each number of workers in turn, and print times and runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    system = ec.load("prototype").system
    plant = dataclasses.replace(system, components=[system.component("prototype.plant")], connections=[])
    experiments = list[ec.Experiment]()
    for seed, (name, (duration, load)) in enumerate(EXPERIMENTS.items(), start=1):
        inputs, measured = measure(duration, load, seed)
        experiments.append(ec.Experiment(name, [measured], {"input": [inputs]}))
    seconds_by_workers: dict[int, list[float]] = {workers: [] for workers in arguments.workers}
    options: dict[str, Any] = {"step_size": STEP, "algorithm": "jacobi"}
    options["set"] = {"prototype.plant.start.x_L": 0.05}
    for _ in range(arguments.rounds):
        for workers in arguments.workers:
            begin = time.perf_counter()
            result = ec.identify(plant, RANGES, experiments=experiments, workers=workers, **options)
            seconds_by_workers[workers].append(time.perf_counter() - begin)
            print(
                f"{workers} workers: {seconds_by_workers[workers][-1]:.1f} s, {result.runs} runs", flush=True
            )
    for estimate in result.estimates:
        true = TRUE.get(estimate.name.removeprefix("prototype.plant."), "")
        print(f"  {estimate.name}: {estimate.value:.5g} +- {estimate.error}, {true}{estimate.problem or ''}")
    print("\n".join(f"  {note}" for note in result.notes))
    for workers, times in seconds_by_workers.items():
        ratio = statistics.median(times) / statistics.median(seconds_by_workers[arguments.workers[0]])
        print(f"{workers} workers: median {statistics.median(times):.1f} s, {ratio:.2f} of the first")
    return 0


if __name__ == "__main__":
    sys.exit(main())

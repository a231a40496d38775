"""How often intervals of `emla identify` contain the truth: machines with drawn parameters, identified.

    python -m benchmarks.identification prototype lift --seeds 100 --json coverage.json

Each machine is a joint in its control loop, with noise of the current sensors and an encoder of 12 bits. It
is identified from its voltages and its load, which drive the plant alone, and from encoder and q-axis
current. Runs take place in this process, which is faster than workers for runs of some milliseconds.
"""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import polars

import emla_cosim as ec
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.analyses.frame.session import Job, Outcomes, Session
from emla_cosim.analyses.variants.measures import (
    DONE,
    FAILED,
    Measures,
    SimulationDescription,
    VariantOutcome,
)
from emla_cosim.base.errors import CosimError
from emla_cosim.run.simulation import Simulation

RANGES = {
    "motor.J_m": "0.001:0.1",
    "motor.Phi_PM": "0.05:0.5",
    "motor.B_m": "0.0005:0.1",
    "friction.F_C": "10:5000",
    "motor.tau_th": "10:1000",
}
"""Unknown parameters of the plant. The last one has no influence: R_s does not follow the temperature."""

VISCOUS = "motor.B_m"
TRUE = tuple(RANGES)[:-1]
"""Parameters that differ from those of the joint."""

DELAY = "0 ms:3 ms"
"""Range of the delay of the encoder."""

STOP = 0.6
"""Length of a measurement in s: there and back."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """How a joint is tested.

    Attributes:
        lag: distance between start and reference in m.
        far: length of a move in m.
        coarse: whether the controller has the encoder of the measurement. The lift's has its own one: with
            12 bits it rattles.
        known: parameters that are known, since the data of this test do not tell them apart.
    """

    lag: float
    far: float
    coarse: bool
    known: tuple[str, ...] = ()


TESTS = {"prototype": Trial(4e-3, 1e-2, True), "lift": Trial(0.0, 1e-3, False, (VISCOUS,))}
"""The lift moves slowly: with voltages as inputs, fast moves are unstable, and several values fit."""

INPUTS = ("u_q", "u_d", "F_L", "d_2", "d_3", "d_4")
"""Inputs of the plant that are recorded."""

STEP = 1e-4
"""Communication step in s."""

STEPS_PER_ROW = 10
"""Steps from one sample of the measurement to the next."""

BITS = 12
"""Resolution of the encoder."""


@dataclasses.dataclass(frozen=True)
class Machine:
    """A machine and what was measured of it."""

    true: dict[str, float]
    inputs: ec.Input
    measured: ec.Input


def draw_machine(joint: str, seed: int) -> Machine:
    """Return a machine whose parameters are within 30 % of those of its joint, and its measurement."""
    random = np.random.default_rng(seed)
    test = TESTS[joint]
    plant = ec.load(joint).system.component(f"{joint}.plant").parameters
    usual = {**plant, VISCOUS: 0.01, "friction.F_C": 300.0}
    true = {name: float(usual[name]) * random.uniform(0.7, 1.3) for name in TRUE}
    delay = random.uniform(0.2e-3, 1.5e-3)
    resolution = float(plant["screw.lead"]) * float(plant["gearbox.rho"]) / 2**BITS
    begin = float(plant["start.x_L"]) + test.lag
    more: dict[str, Any] = {
        "plant.sensor.resolution": resolution if test.coarse else plant["sensor.resolution"],
        "plant.sensor.current.sigma": 0.2,
        "plant.sensor.current.seed": int(random.integers(1, 2**31 - 2)),
        "reference.waypoint": [begin, begin + test.far, begin],
        "reference.move.start": [0.0, 0.3],
        "reference.move.duration": [0.25, 0.25],
    }
    true_values = {f"{joint}.plant.{name}": value for name, value in true.items()}
    true_values |= {f"{joint}.{name}": value for name, value in more.items()}
    run = ec.load(joint, stop_time=STOP, output_interval=STEP, set=true_values).prepare().run()
    sources = {name: "controller" if name in ("u_q", "u_d") else "disturbance" for name in INPUTS}
    driven = {name: run[f"{joint}.{of}.{name}"] for name, of in sources.items()}
    signals = {f"{joint}.plant.{name}": ec.Column(name) for name in INPUTS}
    inputs = ec.Input(data={"time": run.time, **driven}, signals=signals, interpolation="held")
    late_x = np.interp(run.time - delay, run.time, run[f"{joint}.plant.x_L"])
    columns = {
        "time": run.time,
        "x": resolution * np.round(late_x / resolution),
        "i_q": run[f"{joint}.plant.i_q_measured"],
    }
    data = {name: column[STEPS_PER_ROW::STEPS_PER_ROW] for name, column in columns.items()}
    measured = ec.Input(
        data=data, signals={f"{joint}.plant.x_L": ec.Column("x"), f"{joint}.plant.i_q": ec.Column("i_q")}
    )
    return Machine({**true, "delay": delay}, inputs, measured)


class LocalRuns:
    """Runs in this process."""

    def __init__(self, preparations: Sequence[Preparation]) -> None:
        self.count = 0
        self.simulations = [
            Simulation(
                preparation.system_with(preparation.files),
                dataclasses.replace(preparation.options, threads=1),
                preparation.name,
            )
            for preparation in preparations
        ]

    def describe(self, group: int) -> SimulationDescription:
        """Return a description without content: memory for predictions does not matter here."""
        return SimulationDescription({}, {}, {}, 0)

    def run(self, jobs: Sequence[Job], measures: Measures, bytes_each: int) -> Outcomes:
        """Run jobs, and return their signals."""
        outcomes = Outcomes(complete=True)
        self.count += len(jobs)
        for position, job in enumerate(jobs):
            outcomes.by_job[position] = VariantOutcome(position, DONE)
            try:
                if job.is_halved:
                    raise CosimError("the step is not judged in this benchmark")
                run = self.simulations[job.group].run(signals=measures.signals, **job.options)
                signals = {name: run[name] for name in measures.signals}
                outcomes.series[position] = polars.DataFrame({"time": run.time, **signals})
            except CosimError as error:
                outcomes.by_job[position] = VariantOutcome(position, FAILED, str(error))
        return outcomes


@contextmanager
def open_local_runs(session: object, preparations: Sequence[Preparation]) -> Iterator[LocalRuns]:
    """Open runs in this process, in place of workers."""
    yield LocalRuns(preparations)


def identify(joint: str, machine: Machine) -> ec.IdentificationResult:
    """Return what is identified of a machine: its plant alone, driven by the recorded inputs."""
    system = ec.load(joint).system
    plant = dataclasses.replace(system, components=[system.component(f"{joint}.plant")], connections=[])
    given_names = TESTS[joint].known
    vary = {f"{joint}.plant.{name}": ends for name, ends in RANGES.items() if name not in given_names}
    certain = {f"{joint}.plant.{name}": machine.true[name] for name in given_names}
    with patch.object(Session, "open_runs", open_local_runs):
        return ec.identify(
            plant,
            {**vary, f"delay({joint}.plant.x_L)": DELAY},
            measured=[machine.measured],
            input=[machine.inputs],
            set=certain,
            step_size=STEP,
            algorithm="jacobi",
        )


def measure(joint: str, seed: int) -> dict[str, Any]:
    """Return what an identification found of a machine, and the truth."""
    machine, begin = draw_machine(joint, seed), time.perf_counter()
    result = identify(joint, machine)
    estimates = [
        {
            "name": name,
            "true": machine.true.get(name),
            "value": estimate.value,
            "error": estimate.error,
            "interval": estimate.interval,
            "problem": estimate.problem,
        }
        for name, estimate in zip(list_names(joint), result.estimates, strict=True)
    ]
    return {
        "joint": joint,
        "seed": seed,
        "estimates": estimates,
        "white": [estimate.is_white for estimate in result.fits],
        "notes": list(result.notes),
        "runs": result.runs,
        "seconds": time.perf_counter() - begin,
    }


def list_names(joint: str) -> list[str]:
    """Return the names of what is estimated of a joint."""
    return [*(name for name in RANGES if name not in TESTS[joint].known), "delay"]


def count(joint: str, results: list[dict[str, Any]]) -> list[str]:
    """Return a line for each parameter: how often its interval contains the truth."""
    lines = list[str]()
    for i, name in enumerate(list_names(joint)):
        all_ = [result["estimates"][i] for result in results]
        with_interval = [result for result in all_ if result["interval"] is not None]
        inside = sum(
            result["interval"][0] <= result["true"] <= result["interval"][1]
            for result in with_interval
            if result["true"]
        )
        errors = [result["error"] / abs(result["value"]) for result in with_interval]
        width = f", median standard error {100.0 * float(np.median(errors)):.2g} %" if errors else ""
        lines.append(
            f"{name}: {inside} of {len(all_)}, {len(all_) - len(with_interval)} not identified{width}"
        )
    return lines


def main() -> int:
    """Measure the machines of some joints, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("joints", nargs="+")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    all_results = list[dict[str, Any]]()
    for joint in arguments.joints:
        results = list[dict[str, Any]]()
        for seed in range(arguments.first, arguments.first + arguments.seeds):
            results.append(measure(joint, seed))
            if arguments.json is not None:
                arguments.json.write_text(json.dumps([*all_results, *results], indent=1))
        all_results += results
        runs, seconds = (
            float(np.median([result[name] for result in results])) for name in ("runs", "seconds")
        )
        print(f"{joint}, {len(results)} seeds, medians of {runs:.0f} runs and {seconds:.1f} s")
        print("\n".join(f"  {line}" for line in count(joint, results)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

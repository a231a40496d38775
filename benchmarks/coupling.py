"""Measure the cost of strong coupling: python -m benchmarks.coupling.

Rates depend on the machine and its load. Ratios are to `study`, which calls every FMU once per step.
"""

import numpy as np

import emla_cosim as ec

ROUNDS = 5
WAYS: dict[str, tuple[str, dict, float]] = {
    "study, gauss-seidel": ("study", {}, 2.0),
    "study, strong": ("study", {"algorithm": "strong"}, 1.0),
    "hdrm-coupled, strong": ("hdrm-coupled", {}, 2.0),
    "the same with extrapolation": ("hdrm-coupled", {"extrapolation": "fmu"}, 2.0),
}
"""What is run: scenario, options, and simulated time in s."""


def main() -> None:
    """Measure and print."""
    rates: dict[str, list[float]] = {way: [] for way in WAYS}
    sweeps: dict[str, float] = {}
    for _ in range(ROUNDS):
        for way, (scenario, options, stop_time) in WAYS.items():
            with ec.load(scenario, **options).prepare() as simulation:
                result = simulation.run(stop_time=stop_time, recorders=[])
            rates[way].append(result.steps / result.wall_s)
            sweeps[way] = result.stepping.get("sweeps_over_loops", 0) / result.steps
    study = np.median(rates["study, gauss-seidel"])
    print("| | Steps/s | Ratio | Sweeps per step, all loops |\n|---|---|---|---|")
    for way, samples in rates.items():
        rate = np.median(samples)
        print(f"| {way} | {rate:.0f} | {rate / study:.3g} | {sweeps[way]:.2f} |")


if __name__ == "__main__":
    main()

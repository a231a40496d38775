"""Measure the cost of data as inputs: python -m benchmarks.inputs.

The study runs with the load of one joint from a million rows, and without. Rates depend on the machine and
its load. Ratios are to the run without data.
"""

import numpy as np

import emla_cosim as ec

ROUNDS, ROWS, STOP = 7, 1_000_000, 20.0


def main() -> None:
    """Measure and print."""
    times = np.linspace(0.0, STOP, ROWS)
    data = {"time": times, "force": 3.0 + 0.5 * np.cos(7.0 * times)}
    signals = {"lift.disturbance.F_L": "force [kN]"}
    ways = {kind: [ec.Input(data=data, signals=signals, interpolation=kind)] for kind in ("linear", "cubic")}
    ready = {way: ec.load("study", stop_time=STOP, input=source) for way, source in ways.items()}
    simulations = {w: s.prepare() for w, s in {"none": ec.load("study", stop_time=STOP), **ready}.items()}
    rates: dict[str, list[float]] = {way: [] for way in simulations}
    for _ in range(ROUNDS):
        for way, simulation in simulations.items():
            result = simulation.run(recorders=[])
            rates[way].append(result.steps / result.wall_s)
    print("| Rows between which | Steps/s | Ratio |\n|---|---|---|")
    for way, samples in rates.items():
        print(f"| {way} | {np.median(samples):.0f} | {np.median(samples) / np.median(rates['none']):.3g} |")


if __name__ == "__main__":
    main()

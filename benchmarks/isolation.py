"""Measure the cost of FMUs in their own processes: python -m benchmarks.isolation.

Rates depend on the machine and its load. Ratios are to the same run without isolation.
"""

from collections.abc import Sequence

import numpy as np

import emla_cosim as ec

ROUNDS = 5
WAYS: dict[str, Sequence[str] | bool] = {
    "none": False,
    "the plant": ["lift.plant"],
    "all five FMUs": True,
}
"""What is isolated: the option `isolate`."""


def main() -> None:
    """Measure and print."""
    rates: dict[str, list[float]] = {way: [] for way in WAYS}
    for _ in range(ROUNDS):
        for way, isolate in WAYS.items():
            with ec.load("lift").prepare(isolate=isolate) as lift:
                result = lift.run(stop_time=0.2 if isolate else 2.0)
            rates[way].append(result.steps / result.wall_s)
    reference_rate = np.median(rates["none"])
    print("| Isolated | Steps/s | Ratio |\n|---|---|---|")
    for way, samples in rates.items():
        print(f"| {way} | {np.median(samples):.0f} | {np.median(samples) / reference_rate:.3g} |")


if __name__ == "__main__":
    main()

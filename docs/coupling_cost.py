"""Print the table of docs/master.md: the cost of the coupling beside the true error of the run.

The cases are pairs of linear components, whose exact solution is a matrix exponential. Needs the project
with the extra `test`.
"""

from tests.support.coupled_pair import Parts, rigid_pair, run_pair, spring_pair

HEAVY, SPRINGS = (3, 1), (2, 1)
"""The positions of effort and flow among the outputs of both kinds of pair."""

CASES: tuple[tuple[str, Parts, str, str, float, float], ...] = (
    ("load of 1,000 times the mass", rigid_pair(1000.0), "strong", "none", 1e-3, 5.0),
    ("", rigid_pair(1000.0), "strong", "none", 1e-4, 2.0),
    ("", rigid_pair(1000.0), "strong", "fmu", 1e-3, 5.0),
    ("load of 10 times the mass", rigid_pair(10.0), "strong", "none", 1e-3, 5.0),
    ("", rigid_pair(10.0), "strong", "none", 1e-4, 2.0),
    ("undamped springs", spring_pair(1000.0, 1000.0), "jacobi", "none", 1e-3, 10.0),
    ("", spring_pair(1000.0, 1000.0), "jacobi", "none", 1e-4, 3.0),
    ("", spring_pair(1000.0, 1000.0), "gauss-seidel", "none", 1e-3, 10.0),
    ("", spring_pair(1000.0, 1000.0), "gauss-seidel", "fmu", 1e-3, 10.0),
    ("undamped soft springs", spring_pair(10.0, 100.0), "jacobi", "none", 1e-3, 10.0),
    ("damped springs, 20 %", spring_pair(1000.0, 1000.0, 9.0), "jacobi", "none", 2e-4, 3.0),
    ("damped soft springs, 20 %", spring_pair(10.0, 100.0, 2.1), "jacobi", "none", 1e-3, 10.0),
)
"""Label, pair, algorithm, extrapolation, step and stop time in s."""


def main() -> None:
    """Run all cases, with and without the bond."""
    print("| Pair | Algorithm, step | True error | Energy of the bond | Largest residual | Warning |")
    print("|---|---|---|---|---|---|")
    for label, pair, algorithm, extrapolation, step, stop in CASES:
        ends = SPRINGS if len(pair[1]) == 3 else HEAVY
        named = run_pair(pair, algorithm, step, stop, extrapolation, ends)
        free = run_pair(pair, algorithm, step, stop, extrapolation).cost()
        cost = named.cost()
        residual = max(figures["residual"] for figures in free.figures().values())
        how = f"`{algorithm}`" + (" `fmu`" if extrapolation == "fmu" else "") + f", {1e3 * step:g} ms"
        warnings = [word for word, one in (("bond", cost), ("no bond", free)) if one.remarks()]
        energy = cost.figures()["pair"]["energy_error"]
        shares = " | ".join(_percent(share) for share in (named.error, energy, residual))
        print(f"| {label} | {how} | {shares} | {', '.join(warnings) or 'none'} |", flush=True)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:,.0f} %"


if __name__ == "__main__":
    main()

"""The terminal shows counts, figures, worst variants and sensitivities of a sweep."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from emla_cosim.analyses.frame.report import Report
from emla_cosim.analyses.sweep.report import OUTPUTS, build_report, find_worst_variants
from emla_cosim.analyses.sweep.result import SweepResult
from emla_cosim.analyses.variants.factors import Target
from emla_cosim.recorders.metrics import MetricDisplay
from tests.support.sweep_results import swept

pytestmark = pytest.mark.filterwarnings("error")

DISPLAYS = {
    "lift.error_m": MetricDisplay("error_m", "error", 1e6, "µm", "m"),
    "lift.held": MetricDisplay("held", "held"),
}
STATUS = ["done"] * 8 + ["diverged", "done", "died"]


def make(**fields: Any) -> SweepResult:
    return swept(
        {"a": range(11)},
        {
            "lift.held": [i != 3 for i in range(11)],
            "lift.error_m": [1e-6, 2e-6, 7e-6, 3e-6, None, 5e-6, 4e-6, 0.02, 9.0, 5e-6, None],
            "plain": [float(i) for i in range(11)],
        },
        status=STATUS,
        displays=DISPLAYS,
        **fields,
    )


def lines(report: Report, width: int = 100) -> list[str]:
    """What the terminal shows, the cells of tables parted by single spaces."""
    console = Console(width=width, record=True, force_terminal=False)
    with console.capture() as capture:
        for section in report.sections:
            if not section.is_detail:
                for part in (*section.lines, *(table.rich() for table in section.tables), *section.under):
                    console.print(part, soft_wrap=isinstance(part, str))
    return [
        " ".join(line.translate(str.maketrans("│┃", "  ")).split()) for line in capture.get().splitlines()
    ]


def test_counts_by_status_and_figures_in_display_units() -> None:
    printed = lines(build_report(make(sampling="grid")))
    assert printed[0] == "11 variants: 9 done (1 of them not held), 1 diverged, 1 died"
    assert printed[1] == "Figures of the variants that are done (9)"
    assert printed[3] == "least median 95 % largest"
    values = np.array([1, 2, 7, 3, 5, 4, 20_000, 5])
    high = f"{np.percentile(values, 95) / 1e6:.4g} m"
    assert "lift held 8 of 9 yes" in printed
    assert f"lift error 1 4.5 {high} 0.02 m µm" in printed
    assert "plain 0 4 8.2 9" in printed


def test_worst_variants_are_failed_ones_first() -> None:
    by_error, by_verdict = (
        find_worst_variants(make(), f"lift.{n}", 20)["variant"] for n in ("error_m", "held")
    )
    assert by_error.to_list() == [8, 10, 3, 4, 7, 2, 5, 9, 6, 1, 0]
    assert by_verdict.to_list()[:5] == [8, 10, 3, 0, 1]
    worst = find_worst_variants(make(), "plain", 4).row(3, named=True)
    assert (worst["variant"], worst["status"], worst["problem"], worst["plain"]) == (9, "done", None, 9.0)
    assert find_worst_variants(make(), "plain", 0).is_empty()


def test_worst_variants_have_their_problem() -> None:
    printed = lines(build_report(make()))
    start = printed.index("variant status lift error / µm")
    assert printed[start + 2 : start + 7] == [
        "8 diverged 9 m it diverged at 0.3 s.",
        "10 died none it died at 0.3 s.",
        "3 not held 3",
        "4 done none",
        "7 done 0.02 m",
    ]


def test_worst_variants_have_their_command() -> None:
    result = replace(make(), base=["emla", "run", "my study"], targets={"a": [Target("x.y[1]")]})
    commands = [f"emla run 'my study' --set 'x.y[1]={n}'" for n in (8, 10, 3, 4, 7)]
    assert lines(build_report(result))[-6:] == ["Commands to run each alone:", *commands]
    assert lines(build_report(make()))[-1].startswith("└")


def test_long_commands_have_a_file(tmp_path: Path) -> None:
    many = replace(make(), base=["emla", "run", "x" * 400], targets={"a": [Target("y")]}, folder=tmp_path)
    text = OUTPUTS.tables["worst.txt"](many)
    assert isinstance(text, str) and text.startswith("# Commands to run each alone:\nemla run xxx")
    assert lines(build_report(many))[-1] == f"Commands to run each of them alone are in {tmp_path}/worst.txt."
    assert OUTPUTS.tables["worst.txt"](make()) is None


def test_summary_of_a_saltelli_sample() -> None:
    a, b = np.random.default_rng(0).random((2, 3000))
    rows = np.column_stack([a, b, a, b]).ravel()  # a, then with the first factor of b, the second, b
    values = [None, *rows[1:]]
    printed = lines(build_report(swept({"x[red]": rows, "y": rows}, {"f": values}, "saltelli")))
    assert "Sobol indices of f, from 2999 base samples, 1 left out" in printed
    first, second = (line.split() for line in printed if line.startswith(("x[red]", "y ")))
    assert first[0] == "x[red]" and float(first[1]) == pytest.approx(1.0, abs=0.1)
    assert second == ["y", "0.00", "±", "0.00", "0.00", "±", "0.00"]


def test_too_few_base_samples_are_reported() -> None:
    printed = " ".join(lines(build_report(swept({"x": range(3)}, {"f": range(3)}, "saltelli"))))
    assert "1 of 1 base samples of the sweep 'made-up' have the figure 'f'" in printed


def test_summary_of_one_at_a_time() -> None:
    result = swept(
        {"x": range(5), "y[b]": range(5)},
        {"lift.error_m": [1e-6, 2e-6, 1e-6, 4e-6, None]},
        "one-at-a-time",
        displays=DISPLAYS,
    )
    printed = lines(build_report(result))
    start = printed.index("lift error in µm, each factor alone")
    assert printed[start + 2] == "low nominal high"
    assert printed[start + 4 : start + 6] == ["y[b] 4 1 none", "x 2 1 1"]


@pytest.mark.parametrize("sampling", ["grid", "one-at-a-time"])
def test_summaries_of_empty_sweeps(sampling: str) -> None:
    assert lines(build_report(swept({"a": []}, {"f": []}, sampling))) == ["0 variants: none"]
    assert lines(build_report(swept({"a": [1, 2]}, {}, sampling))) == ["2 variants: 2 done"]
    failed = lines(build_report(swept({"a": [1]}, {"f": [None]}, sampling, ["refused"])))
    assert failed[:2] == ["1 variant: 1 refused", "The worst variants"]


def test_long_names_are_complete_and_not_markup() -> None:
    name = "[bold]a_<$" + "long.name" * 9
    printed = lines(build_report(swept({name: [1, 2]}, {name + "!": [1.0, 2.0]}, name=name)), 60)
    assert name + "!" in "".join(line.split(" ")[0] for line in printed[5:])

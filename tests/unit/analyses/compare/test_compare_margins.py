"""The table of margins equals the equations of the drive; loops without margins have a problem in words."""

from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.compare.stability import FIGURES, list_missed_conditions
from emla_cosim.analyses.linearize.report import build_report
from emla_cosim.analyses.linearize.response import compute_margins
from fmublock import Block, DiscreteState, Input, Output
from tests.support.linear_drive import POSITION, STEP, LinearDrive

DELAY = {"lift.plant.inverter.delay": STEP}
FASTEST = 0.402  # s: half of the move of 0.803 s, on the grid
STOP = 0.6  # s


def compare_margins(controller: str, gains: str, **fields: Any) -> ec.CompareResult:
    options = {"table": "margins", "seeds": 0, "set": DELAY, "stop_time": STOP, **fields}
    return ec.compare("lift", [controller], gains=[gains], **options)


@pytest.fixture(scope="module")
def compared(
    fmu_folder: Path, scheduler: Client, tmp_path_factory: pytest.TempPathFactory
) -> ec.CompareResult:
    output = tmp_path_factory.mktemp("margins")
    return compare_margins("rsba", "compensated", fmus=fmu_folder, scheduler=scheduler, output=output)


def check_margins(row: dict[str, Any], fmus: Path) -> None:
    """Compare the margins of a row with those of the equations."""
    assert row["margins_at_s"] == pytest.approx(FASTEST, abs=0.0015)
    assert row["computing_delay_s"] == STEP
    options = {"controller": row["controller"], "gains": row["gains"], "set": DELAY, "stop_time": STOP}
    with ec.load("lift", **options, fmus=fmus).prepare() as run:
        run.advance(row["margins_at_s"])
        v, i_q, i_d = (run[f"lift.plant.{n}"] for n in ("v_L", "i_q_measured", "i_d_measured"))
    frequency = np.geomspace(20.0, 4999.0, 2000)
    drive = LinearDrive(row["controller"], v, i_q, i_d)
    expected = compute_margins(frequency, drive.loop_gain(POSITION, frequency))
    phase, up, down, Ms, delay = (row[f"position_loop_{name}"] for name in FIGURES)
    assert row["position_loop_problem"] is None
    assert phase == pytest.approx(expected.phase_deg, abs=0.3)
    assert (up, down) == pytest.approx((expected.gain_up_dB, expected.gain_down_dB), abs=0.1)
    assert (Ms, delay) == pytest.approx((expected.Ms, expected.delay_s), rel=0.02)


def test_margins_equal_those_of_the_equations(compared: ec.CompareResult, fmu_folder: Path) -> None:
    (row,) = compared.rows.rows(named=True)
    check_margins(row, fmu_folder)


@pytest.mark.slow
def test_margins_of_foc_equal_those_of_the_equations(fmu_folder: Path, scheduler: Client) -> None:
    (row,) = compare_margins("foc", "tuned", fmus=fmu_folder, scheduler=scheduler).rows.rows(named=True)
    check_margins(row, fmu_folder)


def test_margins_of_current_loops_equal_those_of_linearize(
    compared: ec.CompareResult, fmu_folder: Path
) -> None:
    (row,) = compared.rows.rows(named=True)
    opening = "lift.controller.u_q -> lift.plant.u_q"
    options = {"controller": "rsba", "gains": "compensated", "set": DELAY, "stop_time": STOP}
    at = {"at": row["margins_at_s"], "duration": 0.15, "fmus": fmu_folder}
    result = ec.linearize("lift", open=opening, **at, **options)
    assert row["current_loop_phase_margin_deg"] == pytest.approx(result.margins[opening].phase_deg, rel=1e-6)
    assert row["current_loop_Ms"] == pytest.approx(result.margins[opening].Ms, rel=1e-6)


@pytest.mark.slow
def test_lost_joint_has_a_problem_instead_of_margins(fmu_folder: Path, scheduler: Client) -> None:
    compared = compare_margins("rsba", "published", fmus=fmu_folder, scheduler=scheduler)
    (row,) = compared.rows.rows(named=True)
    assert not row["held"]
    for loop in ("position_loop", "current_loop"):
        problems = ("not linear", "gain stays below 1", "unstable", "not decayed", "run ended")
        assert row[f"{loop}_problem"] in problems
        assert all(row[f"{loop}_{name}"] is None for name in FIGURES)
    (grid,) = compared.grids
    (cells,) = ([cell.text for cell in row] for row in grid.cells if row[0].text == "rsba/published")
    assert cells[1].startswith("not held") and cells[-1] == "not met"


def test_tables_mark_unmet_conditions(compared: ec.CompareResult) -> None:
    (grid,) = compared.grids
    rows = {row[0].text: [cell.text for cell in row] for row in grid.cells if row[0].text}
    assert rows["rsba/compensated"][-1] == "not met: phase, gain, Ms"
    assert not {"inf", "nan"} & {c.text.strip("+-") for row in grid.cells for c in row}
    assert compared.folder is not None
    assert "stability margins" in (compared.folder / "comparison.md").read_text()
    table = polars.read_csv(compared.folder / "comparison.csv")
    assert {"position_loop_Ms", "current_loop_problem", "position_error_m"} <= set(table.columns)


@pytest.mark.parametrize(
    ("figures", "missed"),
    [
        ((30.0, 6.0, -6.0, 2.2, 1e-3), []),
        ((29.9, 6.0, None, 2.2, 1e-3), ["phase"]),
        ((30.0, 5.9, -6.0, 2.2, 1e-3), ["gain"]),
        ((30.0, None, -5.9, 2.2, 1e-3), ["gain"]),
        ((40.0, None, None, 2.21, 1e-3), ["Ms"]),
    ],
)
def test_conditions_hold_at_their_limits(figures: tuple[float | None, ...], missed: list[str]) -> None:
    assert list_missed_conditions(dict(zip(FIGURES, figures, strict=True))) == missed


class MarginlessLag(Block):
    """A quarter of the input, inverted; it has a state, so that the loop can be cut."""

    u = Input(1.0)
    before = DiscreteState(0.0)
    y = Output()

    def update(self, v):
        return {"before": v.u}

    def outputs(self, v):
        return {"y": -0.25 * v.u - 0.0 * v.before}


class MarginlessGain(Block):
    """Twice the input."""

    u = Input(1.0)
    y = Output()

    def outputs(self, v):
        return {"y": 2.0 * v.u}


def test_loop_gain_below_1_is_reported() -> None:
    system = ec.System.of(
        {"lag": MarginlessLag, "gain": MarginlessGain}, ("lag.y -> gain.u", "gain.y -> lag.u")
    )
    result = ec.linearize(system, open="lag.y->gain.u", stop_time=4.0, step_size=1e-2)
    remark, _ = result.remarks  # the step is not judged: the lag has discrete variables
    assert "the loop gain stays below 1 from" in remark and "may cut the loop" in remark
    (section,) = build_report(result).sections
    assert any(remark in str(line) for line in section.under)
    texts = {cell.text for table in section.tables for row in table.cells for cell in row}
    assert "none" in texts and not {"inf", "-inf", "nan"} & texts

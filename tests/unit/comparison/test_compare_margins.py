"""The table of margins, compared with the equations of the drive; loops without margins are said in words."""

from pathlib import Path

import numpy as np
import polars
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.comparison.margin_tables import missed_conditions
from emla_cosim.comparison.margins import FIGURES
from emla_cosim.linearization.margins import compute_margins
from emla_cosim.linearization.summary import format_lines, format_margins
from fmublock import Block, DefaultExperiment, DiscreteState, Input, Output
from tests.support.commands import Emla, sentence
from tests.support.linear_drive import POSITION, STEP, LinearDrive

DELAY = {"lift.plant.inverter.delay": STEP}
FASTEST = 0.402  # s: half of the move of 0.803 s, on the grid


@pytest.fixture(scope="module")
def compared(
    fmu_folder: Path, scheduler: Client, tmp_path_factory: pytest.TempPathFactory
) -> ec.CompareResult:
    return ec.compare(
        "lift",
        ["rsba", "foc"],
        gains=["compensated", "published", "tuned"],
        table="margins",
        seeds=0,
        set=DELAY,
        stop_time=0.8,
        fmus=fmu_folder,
        scheduler=scheduler,
        output=tmp_path_factory.mktemp("margins"),
    )


@pytest.mark.parametrize(("controller", "gains"), [("rsba", "compensated"), ("foc", "tuned")])
def test_margins_are_those_of_the_equations(controller: str, gains: str, compared: ec.CompareResult) -> None:
    (row,) = compared.rows.filter(controller=controller, gains=gains).rows(named=True)
    assert row["margins_at_s"] == pytest.approx(FASTEST, abs=0.0015)
    assert row["computing_delay_s"] == STEP
    with ec.load("lift", controller=controller, gains=gains, set=DELAY, stop_time=0.8).prepare() as run:
        run.advance(row["margins_at_s"])
        v, i_q, i_d = (run[f"lift.plant.{n}"] for n in ("v_L", "i_q_measured", "i_d_measured"))
    frequency = np.geomspace(20.0, 4999.0, 4000)
    right = compute_margins(frequency, LinearDrive(controller, v, i_q, i_d).loop_gain(POSITION, frequency))
    assert row["position_loop_problem"] is None
    assert row["position_loop_phase_margin_deg"] == pytest.approx(right.phase_deg, abs=0.3)
    assert row["position_loop_gain_margin_up_dB"] == pytest.approx(right.gain_up_dB, abs=0.1)
    assert row["position_loop_gain_margin_down_dB"] == pytest.approx(right.gain_down_dB, abs=0.1)
    assert row["position_loop_Ms"] == pytest.approx(right.Ms, rel=0.02)
    assert row["position_loop_delay_margin_s"] == pytest.approx(right.delay_s, rel=0.02)


def test_current_loops_have_the_margins_that_linearize_computes(compared: ec.CompareResult) -> None:
    (row,) = compared.rows.filter(controller="foc").rows(named=True)
    place = "lift.controller.u_q -> lift.plant.u_q"
    options = {"controller": "foc", "gains": "tuned", "set": DELAY, "stop_time": 0.8}
    result = ec.linearize("lift", open=place, at=row["margins_at_s"], duration=0.15, **options)
    assert row["current_loop_phase_margin_deg"] == pytest.approx(result.margins[place].phase_deg, rel=1e-6)
    assert row["current_loop_Ms"] == pytest.approx(result.margins[place].Ms, rel=1e-6)


def test_a_joint_that_is_not_held_has_words_instead_of_margins(compared: ec.CompareResult) -> None:
    (row,) = compared.rows.filter(gains="published").rows(named=True)
    assert not row["held"]
    for loop in ("position_loop", "current_loop"):
        assert row[f"{loop}_problem"] in (
            "not linear",
            "gain stays below 1",
            "unstable",
            "not decayed",
            "run ended",
        )
        assert all(row[f"{loop}_{name}"] is None for name in FIGURES)


def test_tables_mark_conditions_and_have_no_infinite_number(compared: ec.CompareResult) -> None:
    (grid,) = compared.grids
    rows = {row[0].text: [cell.text for cell in row] for row in grid.rows if row[0].text}
    assert rows["rsba/compensated"][-1] == "not met: phase, gain, Ms"
    assert rows["rsba/published"][1].startswith("not held") and rows["rsba/published"][-1] == "not met"
    assert not {"inf", "nan"} & {c.text.strip("+-") for row in grid.rows for c in row}
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
    assert missed_conditions(dict(zip(FIGURES, figures, strict=True))) == missed


class MarginlessLag(Block):
    """Half of the input, one step later: a loop gain of 1/2 at all frequencies."""

    default_experiment = DefaultExperiment(stop_time=4.0, step_size=1e-2)
    u = Input(1.0)
    before = DiscreteState(0.0)
    y = Output()

    def update(self, v):
        return {"before": v.u}

    def outputs(self, v):
        return {"y": -0.25 * v.u - 0.0 * v.before}


class MarginlessGain(Block):
    """Twice the input."""

    default_experiment = DefaultExperiment(stop_time=4.0, step_size=1e-2)
    u = Input(1.0)
    y = Output()

    def outputs(self, v):
        return {"y": 2.0 * v.u}


def test_a_loop_whose_gain_stays_below_1_is_said_in_words() -> None:
    system = ec.System.of(
        {"lag": MarginlessLag, "gain": MarginlessGain}, ("lag.y -> gain.u", "gain.y -> lag.u")
    )
    result = ec.linearize(system, open="lag.y->gain.u", stop_time=4.0, step_size=1e-2)
    (remark,) = result.remarks
    assert "the loop gain stays below 1 from" in remark and "may cut the loop" in remark
    assert any(remark in line for line in format_lines(result))
    (table,) = format_margins(result)
    texts = [str(cell) for column in table.columns for cell in column.cells]
    assert "none" in texts and not {"inf", "-inf", "nan"} & set(texts)


def test_the_table_supports_no_resolution(emla: Emla, tmp_path) -> None:
    command = ("compare", "lift", "--table", "margins", "--resolution", "5", "--output", str(tmp_path / "x"))
    assert "only the table stability has a resolution" in sentence(emla(*command), 2)

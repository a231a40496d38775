"""Start values from tables and lists: what FMUs get, and what repeated runs get."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.base.progress import Progress
from emla_cosim.run.preparation import prepare_system
from tests.support.commands import Emla

LEVEL = "lift.disturbance.load.level"
START = "lift.disturbance.load.start"
WAYPOINT = "lift.reference.waypoint"
TABLE = f"""{LEVEL} [kN];{START} [ms];{WAYPOINT} [mm];lift.plant.motor.R_s
30,1;0;240;0,2
42,7;2;243,3;
-5;4;;
"""
SAME = {f"{LEVEL}[{i}]": x for i, x in enumerate((30.1e3, 42.7e3, -5e3), 1)}
SAME |= {f"{START}[{i}]": x for i, x in enumerate((0.0, 0.002, 0.004), 1)}
SAME |= {f"{WAYPOINT}[1]": 0.24, f"{WAYPOINT}[2]": 0.2433, "lift.plant.motor.R_s": 0.2}


def given_by(system: Any) -> dict[str, Any]:
    return {f"{c.name}.{n}": v for c in system.components for n, v in c.parameters.items()}


def values(fmu_folder: Path, *files: Path, system: Any = "lift", **options: Any) -> dict[str, Any]:
    """The start values that a system has when it is prepared."""
    scenario = ec.load(system, fmus=fmu_folder, parameters=list(files), **options)
    return given_by(prepare_system(scenario.system, scenario.options, Progress()).system)


def recorded(folder: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings and start values of a run."""
    record = json.loads(Path(folder, "run.json").read_text())
    components = record["components"].items()
    return record["settings"], {f"{c}.{n}": v for c, x in components for n, v in x["parameters"].items()}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    (tmp_path / "levels.csv").write_text(TABLE)
    return tmp_path / "levels.csv"


def test_table_gives_the_values_to_all_that_use_them(fmu_folder: Path, table: Path, tmp_path: Path) -> None:
    """To runs, workers of sweeps, and packages; a package takes a table as well."""
    before = values(fmu_folder)
    assert values(fmu_folder, table) == values(fmu_folder, set=SAME) == before | SAME
    scenario = ec.load("lift", fmus=fmu_folder, parameters=[table])
    assert given_by(Preparation.of(scenario).system).items() >= SAME.items()
    inside = scenario.export(tmp_path / "inside.ssp")
    plain = ec.load("lift", fmus=fmu_folder).export(tmp_path / "plain.ssp")
    assert values(fmu_folder, system=inside).items() >= SAME.items()
    assert values(fmu_folder, table, system=plain).items() >= SAME.items()


def test_run_records_the_table_and_rerun_notes_its_changes(emla: Emla, fmu_folder: Path, table: Path) -> None:
    options = ("--stop-time", "0.006", "--no-plots", "--output", "table")
    assert emla("run", "lift", *options, "--parameters", "levels.csv").exit_code == 0
    settings_, parameters = recorded("table")
    assert parameters.items() >= SAME.items()
    digest = hashlib.sha256(table.read_bytes()).hexdigest()
    assert settings_["parameters"] == [{"file": "levels.csv", "sha256": digest}]
    rerun = emla("rerun", "table", "--fmus", str(fmu_folder), "--no-plots")
    assert rerun.exit_code == 0 and "to the last bit" in rerun.stdout
    assert "Differences from" not in rerun.stdout
    table.write_text(TABLE.replace("42,7", "42,8"))
    rerun = emla("rerun", "table", "--fmus", str(fmu_folder), "--no-plots", "--output", "other")
    assert "the content of" in rerun.output and "levels.csv" in rerun.output
    assert recorded("other")[1][f"{LEVEL}[2]"] == 42.8e3


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    numbers=st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=6),
    form=st.sampled_from(["csv", "parquet"]),
)
def test_rows_are_elements_and_the_others_stay(
    fmu_folder: Path, tmp_path: Path, numbers: list[int], form: str
) -> None:
    file = tmp_path / f"levels.{form}"
    padded = {f"{LEVEL} / kN": [n / 1e6 for n in numbers] + [None] * 3}
    frame = polars.DataFrame(padded, schema_overrides=dict.fromkeys(padded, polars.Float64))
    frame.write_csv(file) if form == "csv" else frame.write_parquet(file)
    before, after = values(fmu_folder), values(fmu_folder, file)
    assert after == before | {f"{LEVEL}[{i}]": n / 1e3 for i, n in enumerate(numbers, 1)}


def test_elements_whole_numbers_units_and_later_files(fmu_folder: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "one.csv", tmp_path / "two.CSV"
    first.write_text(
        f"{LEVEL}[2] in kN,lift.disturbance.d_2.seed,lift.disturbance.supply.depth [%]\n7,5,30\n"
    )
    second.write_text(f"{LEVEL}\n1\n2\n")
    parameters = values(fmu_folder, first)
    assert (parameters[f"{LEVEL}[2]"], parameters["lift.disturbance.d_2.seed"]) == (7e3, 5)
    assert parameters["lift.disturbance.supply.depth"] == pytest.approx(0.3)
    assert values(fmu_folder, first, second)[f"{LEVEL}[2]"] == 2.0
    assert values(fmu_folder, second, first)[f"{LEVEL}[2]"] == 7e3
    assert values(fmu_folder, second, set={f"{LEVEL}[*]": 9.0})[f"{LEVEL}[2]"] == 9.0


DURATION = "lift.reference.move.duration"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{LEVEL}\n" + "1\n" * 7, f"'{LEVEL}' of the parameter table 'FILE' has a value in row 7, but"),
        (f"{LEVEL},{START}\n1,1\n,2\n3,3\n", f"'FILE' has nothing in row 2 of the column '{LEVEL}'"),
        (f"{LEVEL}\n1\nNaN\n", f"'FILE' has 'NaN' in row 2 of the column '{LEVEL}'"),
        (f"{LEVEL}\n1\ninf\n", "must be a finite number"),
        (f"{LEVEL} [kN]\n1\n1e308\n", "row 2: lift.disturbance.load.level[2] = inf N is out of range"),
        (f"{LEVEL} [kV]\n1\n", "of the parameter table 'FILE' has the units kV and N"),
        (f"{LEVEL} [qN]\n1\n", "has the unknown unit 'qN'"),
        ("lift.disturbance.d_2.seed\n1.5\n", "lift.disturbance.d_2.seed = 1.5 is not a whole number"),
        ("lift.disturbance.load.levle\n1\n", "no variable 'load.levle'; did you mean load.level"),
        ("level\n1\n", "the column 'level' of the parameter table 'FILE': 'level' is not a variable"),
        (f"{DURATION}\n1\n0\n", f"'FILE', row 2: {DURATION}[2] = 0 s is out"),
        ("lift.plant.tau_m\n1\n", "lift.plant.tau_m cannot be set: it is computed by the FMU"),
        ("lift.plant.motor.R_s\n1\n2\n", "but lift.plant.motor.R_s has 1 element."),
        (f"{LEVEL},{START}\n1,\n2,\n", f"the column '{START}' of the parameter table 'FILE' has no number"),
        (f"{LEVEL},{LEVEL}[1]\n1,2\n", f"has a second value for {LEVEL}[1]"),
        ("", "'FILE' is empty"),
    ],
)
def test_invalid_tables(fmu_folder: Path, tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "levels.csv"
    file.write_text(text)
    with pytest.raises(ec.CommandError) as caught:
        values(fmu_folder, file)
    assert message.replace("FILE", str(file)) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_invalid_parquet_files(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "levels.parquet"
    for column in (["one"], [None], [float("nan")], [True]):
        polars.DataFrame({LEVEL: column}).write_parquet(file)
        with pytest.raises(ec.CommandError, match=r"levels\.parquet"):
            values(fmu_folder, file)
    file.write_bytes(b"PAR1 and nothing more")
    with pytest.raises(ec.CommandError, match="not a Parquet file"):
        values(fmu_folder, file)
    with pytest.raises(ec.CommandError, match="cannot be read"):
        values(fmu_folder, tmp_path / "gone.csv")


def test_list_sets_the_elements_of_an_array(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        f'system = "lift"\nstop_time = 0.001\n[set]\n"{LEVEL}" = ["30 kN", 4e4]\n"{START}" = [0, "2 ms"]\n'
    )
    parameters = values(fmu_folder, system=tmp_path / "mine.toml", set={f"{LEVEL}[2]": "50 kN"})
    assert [parameters[f"{LEVEL}[{i}]"] for i in (1, 2)] == [30e3, 50e3]
    assert [parameters[f"{START}[{i}]"] for i in (1, 2)] == [0, 0.002]
    for name, many in ((LEVEL, (30e3, 40e3)), ("*.load.level", np.array([30e3, 40e3]))):
        parameters = values(fmu_folder, set={name: many})
        assert [parameters[f"{LEVEL}[{i}]"] for i in (1, 2)] == [30e3, 40e3]


@pytest.mark.parametrize(
    ("many", "message"),
    [
        ([], "must be a number"),
        ([[1.0, 2.0], [3.0]], "differ in length"),
        ([[]], "are empty or differ"),
        ([1.0, None], "must be a number"),
        ([1.0, float("nan")], "out of range"),
    ],
)
def test_invalid_lists(fmu_folder: Path, many: list[Any], message: str) -> None:
    with pytest.raises(ec.CommandError) as caught:
        ec.load("lift", fmus=fmu_folder, set={LEVEL: many}).prepare().close()
    assert message in str(caught.value)

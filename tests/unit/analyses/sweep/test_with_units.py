"""Values with units in plans and on the command line are numbers in the unit of the variable."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import polars
import pytest

import emla_cosim as ec
from emla_cosim.analyses.sweep.plan import design_variants, load_plan
from emla_cosim.base.progress import Progress
from emla_cosim.base.units import LinearTransformation, SiUnit
from emla_cosim.system.model import Alias, Component, System
from fmublock import Block, Output, Parameter, build
from tests.support.commands import Emla
from tests.support.toy_fmu import PRODUCER

pytestmark = pytest.mark.usefixtures("on_one_cluster")

LEAD, L_D, L_Q = "lift.plant.screw.lead", "lift.plant.motor.L_d", "lift.plant.motor.L_q"


def table(vary: Any, fmu_folder: Path, **plan: Any) -> tuple[dict[str, list[Any]], list[str]]:
    """What varies by variant, and the units of the factors."""
    options = {"fmus": fmu_folder, **plan.pop("options", {})}
    design = design_variants(
        load_plan("lift").updated({"vary": vary, "options": options, **plan}), Progress()
    )
    return design.table().drop("variant").to_dict(as_series=False), [f.unit for f in design.factors]


@pytest.mark.parametrize(
    ("form", "values"),
    [
        ("10 mm:20 mm:3", [0.01, 0.015, 0.02]),
        ("10mm:2 cm:3", [0.01, 0.015, 0.02]),
        ("900 um:1 mm:2", [0.0009, 0.001]),
        ("0:20 mm:2", [0.0, 0.02]),
        ("10 mm", [0.01]),
        ("10 mm, 0.02 m", [0.01, 0.02]),
        (["10 mm", "2 cm"], [0.01, 0.02]),
        ("0,5 cm:1,5 cm:2", [0.005, 0.015]),
        (["0,5 cm", "1,5 cm"], [0.005, 0.015]),
        ("log-uniform(1 mm, 100 mm, 3)", [0.001, 0.01, 0.1]),
        ("log-uniform(low = 1 mm, high = 100 mm, points = 2)", [0.001, 0.1]),
        ({"distribution": "uniform", "low": "1 mm", "high": "3 mm", "points": 3}, [0.001, 0.002, 0.003]),
        ({"distribution": "values", "values": ["1 mm", "3 mm"]}, [0.001, 0.003]),
        ("0.01:0.02:2", [0.01, 0.02]),
        ("50%:100%:2", [0.01, 0.02]),
    ],
    ids=str,
)
def test_values_with_units(form: Any, values: list[float], fmu_folder: Path) -> None:
    columns, units = table({LEAD: form}, fmu_folder)
    assert columns == {LEAD: pytest.approx(values, rel=1e-15)}
    assert units == ["m"]
    assert all(type(value) is float for value in columns[LEAD])


def test_samples_have_the_unit_of_the_variable(fmu_folder: Path) -> None:
    for with_unit, plain in (
        ("normal(16 mm, 1 mm)", "normal(0.016, 0.001)"),
        ("log-normal(16 mm, 0.1)", "log-normal(0.016, 0.1)"),
        ("triangular(1 mm, 2 mm, 5 mm)", "triangular(0.001, 0.002, 0.005)"),
    ):
        (sample, _), (expected, _) = (
            table({LEAD: x}, fmu_folder, runs=5, seed=3) for x in (with_unit, plain)
        )
        assert sample[LEAD] == pytest.approx(expected[LEAD], rel=1e-14)


def test_units_in_patterns_several_targets_and_options(fmu_folder: Path) -> None:
    columns, units = table({"lift.plant.motor.L_?": "1 mH,2 mH"}, fmu_folder)
    assert columns == {L_D: [0.001, 0.001, 0.002, 0.002], L_Q: [0.001, 0.002, 0.001, 0.002]}
    entry = {"of": [L_D, L_Q], "distribution": "values", "values": ["1 mH", "2 mH"]}
    assert table({"L": entry}, fmu_folder) == ({"L": [0.001, 0.002]}, ["H"])
    assert table({"stop_time": "100 ms, 1 s"}, fmu_folder) == ({"stop_time": [0.1, 1.0]}, ["s"])
    assert units == ["H", "H"]


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({LEAD: "10:20 mm:3"}, "10 has no unit, but 20 mm has; add a unit to all or none"),
        ({LEAD: ["10 mm", 0.02]}, "0.02 has no unit, but 10 mm has"),
        ({LEAD: "0,5 mm"}, "two meanings; write '0.5 mm', or '0 mm, 5 mm' for two values"),
        ({LEAD: "1 s:2 s:3"}, "1 s has the units s and m"),
        ({LEAD: "1 furlong:2 furlong"}, "the unknown unit 'furlong'"),
        ({"lift.plant.motor.N_p": "4 mm,5 mm"}, "4 mm has a unit, but takes none"),
        ({"x": {"of": [LEAD, L_D], "distribution": "values", "values": ["1 mm"]}}, "with different units"),
        ({LEAD: {"distribution": "values", "values": ["9 mm"], "relative": True}}, "'9 mm' is not a number"),
    ],
    ids=str,
)
def test_incompatible_units_are_refused(vary: Any, message: str, fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match=message) as caught:
        table(vary, fmu_folder)
    assert str(caught.value).startswith(f"'{next(iter(vary))}' of the sweep of 'lift'")


class Gauge(Block):
    """A length in m."""

    length = Parameter(1.0, unit="m")
    y = Output(unit="m")

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": 2.0 * v.length}


def test_unit_is_that_of_the_system(tmp_path: Path) -> None:
    """An FMU in m, and the same one whose length the system calls by another name, in cm."""
    build(Gauge, tmp_path / "Gauge.fmu", producer=PRODUCER)
    cm = Alias("length", LinearTransformation(0.01), SiUnit("cm", (0, 1, 0, 0, 0, 0, 0, 0), 0.01))
    for aliases, name, expected in (({}, "length", [0.002, 0.04]), ({"size": cm}, "size", [0.2, 4.0])):
        system = System((Component("a.b", "Gauge", {}, tmp_path / "Gauge.fmu", aliases),), ())
        design = design_variants(
            load_plan(system).updated({"vary": {f"a.b.{name}": "2 mm,4 cm"}}), Progress()
        )
        assert design.table()[f"a.b.{name}"].to_list() == pytest.approx(expected)


def test_results_have_numbers_without_units(emla: Emla, fmu_folder: Path) -> None:
    process = emla(
        "sweep", "lift", "--vary", f"{LEAD}=19 mm:21 mm:3", "--vary", f"{L_D}=1 mH,2 mH",
        "--stop-time", "0.35", "--workers", "1", "--output", "out", "--fmus", str(fmu_folder),
    )  # fmt: skip
    assert process.exit_code == 0, process.output
    assert f"--set {LEAD}=0.019" in process.stdout
    variants = polars.read_parquet("out/variants.parquet")
    assert variants.schema[LEAD] == variants.schema[L_D] == polars.Float64
    assert sorted(set(variants[LEAD])) == pytest.approx([0.019, 0.02, 0.021])
    assert json.loads(Path("out/sweep.json").read_text())["units"] == {LEAD: "m", L_D: "H"}
    with mpl.rc_context():
        axes = ec.read_sweep("out").plot("map").axes[0]
    assert axes.get_xlabel() == f"{LEAD} / m"
    assert [t.get_text() for t in axes.get_xticklabels()] == ["0.019", "0.02", "0.021"]

"""`emla_cosim.info` agrees with fmpy's reading and with what a simulation accepts."""

import hashlib
import json
from dataclasses import asdict, fields
from pathlib import Path

import fmpy
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.models import MODELS, fmu_path
from emla_cosim.inspection.display_rows import build_display_rows
from tests.support.broken.broken import Broken
from tests.support.broken.static import STATIC
from tests.support.paths import FOREIGN_PLANT, ROOT
from tests.support.tiers import mostly_slow


@pytest.fixture(scope="module")
def study(fmu_folder: Path) -> ec.Info:
    return ec.info("study", fmus=fmu_folder, set={"lift.plant.motor.R_s": 0.2})


@pytest.mark.parametrize("model", MODELS)
def test_fmu_as_read_by_fmpy(model: str, fmu_folder: Path) -> None:
    path = fmu_path(model, "native", fmu_folder)
    texts, content = fmpy.read_model_description(str(path)), ec.info(path)
    assert [v.fmu_name for v in content.variables] == [v.name for v in texts.modelVariables]
    for row, variable in zip(content.variables, texts.modelVariables, strict=True):
        assert row.name == f"{model}.{variable.name}"
        assert (row.causality, row.variability) == (variable.causality, variable.variability)
        assert (row.type, row.unit) == (variable.type, variable.unit)
        assert row.description == (variable.description or "")
        assert row.start == row.default
        assert (row.start is None) == (variable.start is None)
        if variable.type in ("Real", "Integer") and variable.start is not None:
            assert row.start == float(variable.start)
        if variable.type != "Enumeration":
            ends = (None if x is None else float(x) for x in (variable.min, variable.max))
            assert (row.minimum, row.maximum) == tuple(ends)
    [fmu] = content.fmus
    assert fmu.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert list(fmu.platforms) == sorted({*fmpy.supported_platforms(str(path))} - {"c-code"})
    assert fmu.stop_time == float(texts.defaultExperiment.stopTime)
    assert (fmu.guid, fmu.tool, fmu.fmi_version) == (texts.guid, texts.generationTool, "2.0")


@pytest.mark.parametrize("model", MODELS)
def test_settable_variables_can_be_set_and_others_cannot(model: str, fmu_folder: Path) -> None:
    path = fmu_path(model, "native", fmu_folder)
    content = ec.info(path)
    with ec.load(path).prepare() as simulation:
        values = {v.name: v.start for v in content.variables if v.settable}
        assert values
        simulation.start(set=values)
        for variable in content.variables:
            if not variable.settable:
                with pytest.raises(CommandError, match="cannot be set"):
                    simulation.start(set={variable.name: 1.0 if variable.start is None else variable.start})


def test_settable_variables_of_a_system(study: ec.Info, fmu_folder: Path) -> None:
    values = {v.name: v.start for v in study.variables if v.settable}
    with ec.load("study", fmus=fmu_folder).prepare() as simulation:
        simulation.start(set=values, stop_time=1e-3)
        assert not study["lift.plant.u_q"].settable
        with pytest.raises(CommandError, match="cannot be set"):
            simulation.start(set={"lift.plant.u_q": 0.0})


def test_start_values_are_those_of_a_run(study: ec.Info, fmu_folder: Path) -> None:
    changed = {"lift.plant.motor.R_s": 0.2}
    with ec.load("study", fmus=fmu_folder, set=changed).prepare() as simulation:
        parameters = simulation.run(stop_time=1e-3).parameters
    numbers = [v for v in study.variables if v.causality == "parameter" and v.type != "String"]
    start_values = {v.name: v.start for v in numbers}
    assert start_values == parameters
    assert (study["lift.plant.motor.R_s"].start, study["lift.plant.motor.R_s"].default) == (0.2, 0.14)
    assert study["lift.plant.use_commanded_current"].start is False


def test_connections_are_listed_at_both_ends(study: ec.Info, fmu_folder: Path) -> None:
    expected = {str(x) for x in ec.load("study").system.connections}
    assert {f"{x.output} -> {x.input}" for x in study.connections} == expected
    assert {f"{v.driven_by} -> {v.name}" for v in study.variables if v.driven_by} == expected
    assert {f"{v.name} -> {reader}" for v in study.variables for reader in v.read_by} == expected
    faulted = ec.info("lift", fmus=fmu_folder, fault=[ec.Fault("lift.plant.x_measured", "freeze", 1.0)])
    assert faulted["lift.observer.y"].driven_by == "lift.plant_x_measured_fault.y"
    assert faulted["lift.plant_x_measured_fault.start"].start == 1.0


def test_replaced_component_keeps_names_and_units(foreign_plant: Path, fmu_folder: Path) -> None:
    replacement = ec.Replacement(foreign_plant, FOREIGN_PLANT / "ForeignPlant.ssm")
    content = ec.info("lift", fmus=fmu_folder, replace={"lift.plant": replacement})
    ours = ec.info("lift", fmus=fmu_folder)
    of_plant = [v for v in content.variables if v.component == "lift.plant"]
    renamed = [v for v in of_plant if not v.name.endswith(v.fmu_name)]
    assert renamed
    for variable in renamed:
        assert variable.unit == ours[variable.name].unit
        assert variable.settable or variable.causality in ("input", "output")
    set_there = {v.name: v.start for v in renamed if v.settable}
    scenario = ec.load("lift", fmus=fmu_folder, replace={"lift.plant": replacement})
    with scenario.prepare() as simulation:
        simulation.start(set=set_there, stop_time=1e-3)


def test_options_apply(fmu_folder: Path) -> None:
    content = ec.info("lift", controller="foc", fmus=fmu_folder, stop_time=2.0)
    assert {c.model for c in content.components if c.name == "lift.controller"} == {"FocController"}
    assert content.stop_time == 2.0
    with pytest.raises(CommandError, match="out of range"):
        ec.info("lift", set={"lift.plant.motor.R_s": -1.0}, fmus=fmu_folder)


def test_names_are_unique_and_elements_of_arrays_share_rows(fmu_folder: Path) -> None:
    variables = ec.info("hdrm-merged", fmus=fmu_folder).variables
    assert len({v.name for v in variables}) == len(variables)
    assert 0 < len(list(build_display_rows(variables))) < len(variables)


def test_package_has_the_variables_of_its_scenario(fmu_folder: Path, tmp_path: Path) -> None:
    scenario = ec.load("lift", fmus=fmu_folder, set={"lift.plant.motor.R_s": 0.3})
    content, of_scenario = ec.info(scenario.export(tmp_path / "x.ssp")), ec.info("lift", fmus=fmu_folder)
    assert {v.name for v in content.variables} == {v.name for v in of_scenario.variables}
    assert content["lift.plant.motor.R_s"].start == 0.3
    assert all(fmu.path.startswith("x.ssp/") for fmu in content.fmus)


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("lift.*.R_s", ["lift.plant.motor.R_s", "lift.controller.model.R_s"]),
        ("motor.?_s", [f"{joint}.plant.motor.R_s" for joint in ("lift", "tilt", "telescope")]),
        ("lift.reference.waypoint[2]", ["lift.reference.waypoint[2]"]),
        ("LIFT.PLANT.P_EL", ["lift.plant.P_el"]),
    ],
)
def test_patterns_select_variables(pattern: str, names: list[str], study: ec.Info) -> None:
    assert [v.name for v in study.matching(pattern).variables] == names


def test_words_are_searched_in_descriptions(study: ec.Info) -> None:
    words = study.matching("pole pairs")
    assert {v.fmu_name.rpartition(".")[2] for v in words.variables} == {"N_p"}
    assert len(study.matching("pole pairs", "*.x_L").variables) > len(words.variables)
    with pytest.raises(CommandError, match=r"no variable of study matches 'nonsense\*'"):
        study.matching("*.x_L", "nonsense*")
    with pytest.raises(CommandError, match=r"did you mean lift\.plant\.x_L"):
        study["lift.plant.xL"]


FIELDS = {
    "": "format version name description start_time stop_time step_size notes fmus components connections "
    "variables",
    "fmus": "path model description fmi_version kinds platforms start_time stop_time step_size tolerance "
    "tool version author license guid sha256 size capabilities terminals",
    "components": "name model fmu",
    "connections": "output input factor offset",
    "variables": "name component fmu_name causality variability type unit start default minimum maximum "
    "choices description driven_by read_by settable data_type dimensions clocks interval_variability",
}
"""What scripts rely on; docs/info.md describes it."""


def test_json_has_the_documented_fields(study: ec.Info, tmp_path: Path) -> None:
    study.save_json(tmp_path / "x.json")
    read = json.loads((tmp_path / "x.json").read_text(encoding="ascii"))
    assert list(read) == FIELDS[""].split()
    assert (read["format"], read["version"]) == ("emla-info", 1)
    page = (ROOT / "docs" / "info.md").read_text(encoding="utf-8")
    for part, names in FIELDS.items():
        assert all(f'"{name}"' in page for name in names.split())
        for entry in read[part] if part else []:
            assert list(entry) == names.split()
    assert read["variables"][40] == json.loads(json.dumps(asdict(study.variables[40])))


def test_data_frame_has_a_row_per_variable(study: ec.Info) -> None:
    table = study.to_polars()
    assert table.columns == [f.name for f in fields(ec.VariableInfo)]
    assert table.height == len(study.variables)
    [row] = table.filter(polars.col("name") == "lift.plant.motor.R_s").to_dicts()
    assert (row["start"], row["default"], row["minimum"], row["maximum"]) == ("0.2", "0.14", 0.0, None)


@pytest.mark.parametrize("broken", mostly_slow(STATIC, STATIC[::6]), ids=lambda broken: broken.name)
def test_broken_fmu_is_described_or_refused(broken: Broken, tmp_path: Path) -> None:
    path = broken.build(tmp_path)
    try:
        content = ec.info(path)
    except CommandError as error:
        assert "\n" not in str(error)
        assert str(path) in str(error)
    else:
        assert content.variables
        json.loads(content.as_json())

"""Another FMU in the place of a component: same results under our names and units, or one message."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import emla_cosim as ec
from emla_cosim.base.units import SiUnit
from emla_cosim.fmu.parameters.parameter_sets import ParameterSet, SsvParameter, format_parameter_set
from tests.support.commands import Emla, sentence
from tests.support.paths import FOREIGN_MAPPING

TOLERANCE = 1e-9
"""Relative to the largest value of a signal: rounding, amplified by the closed loop in 0.3 s."""
HEAT = ("lift.plant.motor.temperature_rise", "lift.plant.motor.load")
"""Signals that the foreign plant does not model."""
IDEAL = {"lift.plant.sensor.resolution": 0}
"""Without it, rounding of the last digit would move a step of the encoder, and everything after it."""
WITHOUT_MAPPING = "the input F_L [N] is missing, and 12 more do not fit; a mapping may help."


def table_rows(result: Result) -> list[list[str]]:
    """Return the table of matches: kind, our name, name in the FMU and verdict."""
    lines = [line for line in result.output.splitlines() if line.startswith("│")]
    cells = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines]
    return [row for row in cells if len(row) == 4 and row[3] != ""]


def verdicts(result: Result) -> dict[str, str]:
    """Return verdicts by our names, or by names in the FMU where we have none, without units."""
    return {
        re.sub(r" \[.*", "", ours or with_replacement): verdict
        for _, ours, with_replacement, verdict in table_rows(result)
    }


def check_same(actual: ec.Result, expected: ec.Result, tolerance: float) -> None:
    """Check all signals that both results have, relative to their largest value."""
    for name in [n for n in expected.names if n not in HEAT]:
        largest = np.abs(expected[name]).max() or 1.0
        assert np.abs(actual[name] - expected[name]).max() <= tolerance * largest, name


def same_bits(a: ec.Result, b: ec.Result) -> bool:
    return a.names == b.names and all((a[name] == b[name]).all() for name in a.names)


def edited(*changes: tuple[str, str], path: str = "my.ssm") -> Path:
    """Write the mapping of the foreign plant after some changes."""
    text = FOREIGN_MAPPING.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path(path).write_text(text, encoding="utf-8")
    return Path(path)


def mapping(*entries: str, attributes: str = "") -> Path:
    """Write a mapping file; an entry is `source target` or `source target inner XML`."""
    written = [entry.split(" ", 2) for entry in entries]
    lines = (
        f'<ssm:MappingEntry source="{a}" target="{b}" {attributes}>{"".join(inner)}</ssm:MappingEntry>'
        for a, b, *inner in written
    )
    head, _, _ = FOREIGN_MAPPING.read_text(encoding="utf-8").partition("<ssm:MappingEntry")
    Path("my.ssm").write_text(f"{head}{''.join(lines)}</ssm:ParameterMapping>", encoding="utf-8")
    return Path("my.ssm")


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of these tests lie in an empty current folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def foreign(foreign_plant: Path, fmu_folder: Path) -> ec.Scenario:
    """The lift with the foreign plant in the place of ours."""
    replacement = ec.Replacement(foreign_plant, FOREIGN_MAPPING)
    return ec.load("lift", replace={"lift.plant": replacement}, stop_time=0.02, set=IDEAL, fmus=fmu_folder)


@pytest.fixture(scope="module")
def ours(fmu_folder: Path) -> ec.Simulation:
    return ec.load("lift", stop_time=0.02, set=IDEAL, fmus=fmu_folder).prepare()


@pytest.fixture(scope="module")
def with_replacement(foreign: ec.Scenario) -> ec.Simulation:
    return foreign.prepare()


@pytest.fixture(scope="module")
def package(foreign: ec.Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lift with the foreign plant as a package: connections have the factors, parameters the mapping."""
    return foreign.export(tmp_path_factory.mktemp("package") / "my.ssp")


# ---- our plant from another exporter -----------------------------------------------------------------


def test_fmu_with_the_same_names_gives_the_same_bits(emla: Emla, python_fmu_folder: Path) -> None:
    """It shows no table, except on request."""
    python_fmu = python_fmu_folder / "EmlaPlant" / "python" / "EmlaPlant.fmu"
    options = ("run", "lift", "--stop-time", "0.02", "--no-plots")
    replaced = (*options, "--output", "theirs", "--replace", f"lift.plant={python_fmu}")
    assert emla(*options, "--output", "ours").exit_code == 0
    result = emla(*replaced)
    assert Path("ours/results.csv").read_bytes() == Path("theirs/results.csv").read_bytes()
    assert table_rows(result) == []
    assert "EmlaPlant.fmu as lift.plant: all 55 variables match (--show-fit lists them)" in result.stderr
    output = emla(*replaced, "--show-fit")
    assert table_rows(output) == [["", "55 more", "", "same name and unit"]]
    assert "variables match" not in output.stderr
    components = json.loads(Path("theirs/run.json").read_text())["components"]
    assert components["lift.plant"]["fmu"] == str(python_fmu) != components["lift.observer"]["fmu"]


# ---- a plant with other names and units --------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "tolerance"),
    [
        ({}, TOLERANCE),
        ({"algorithm": "strong", "coupling_tolerance": 1e-10}, 100.0 * TOLERANCE),
        ({"error_tolerance": 1e-3, "stop_time": 0.05}, 1e-4),  # rounding moves steps a little
    ],
)
def test_other_names_and_units_give_the_same_results(
    ours: ec.Simulation, with_replacement: ec.Simulation, options: dict[str, Any], tolerance: float
) -> None:
    expected, result = (
        simulation.run(**{"stop_time": 0.3, **options}) for simulation in (ours, with_replacement)
    )
    extra = [name for name in result.names if name not in expected.names]
    assert extra == ["lift.plant.Motor.IqError_A"]
    assert result.steps == expected.steps
    check_same(result, expected, tolerance)
    metrics, of_ours = (
        {n: x for n, x in r.metrics["joints"]["lift"].items() if isinstance(x, float)}
        for r in (result, expected)
    )
    assert metrics == pytest.approx(of_ours, rel=1e-6 if tolerance < 1e-5 else 1e-3, nan_ok=True)
    assert result.metrics["joints"]["lift"]["trip"] is None  # this plant has no such ranges


def test_table_shows_conversions(emla: Emla, foreign_plant: Path) -> None:
    options = ("--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={FOREIGN_MAPPING}")
    result = emla("run", "lift", "--stop-time", "0.001", *options, "--no-plots", "--output", "out")
    table = table_rows(result)
    for row in (
        ["input", "F_L [N]", "Load.Force_kN [kN]", "x -0.001"],
        ["output", "x_measured [m]", "Sensor.Position_mm [mm]", "x 1000 + 850"],
        ["output", "i_q [A]", "Motor.Iq_A [A]", "fits"],
    ):
        assert row in table
    names = [name for _, name, _, _ in table if name]
    assert len(names) == len(set(names))
    mapped = json.loads(Path("out/run.json").read_text())["components"]["lift.plant"]["mapping"]
    assert mapped["x_L"] == "Screw.Position_mm = x_L x 1000 + 850"


def test_values_and_signals_have_our_names_and_units(with_replacement: ec.Simulation) -> None:
    """Parameters of the FMU alone, such as the temperature of its winding, keep their names."""
    result = with_replacement.run(set={"lift.plant.start.x_L": 0.25}, signals=["lift.plant.x_*"])
    assert result.names == ["lift.plant.x_L", "lift.plant.x_measured"]
    assert result["lift.plant.x_L"][0] == pytest.approx(0.25, rel=1e-15)
    assert result.record["components"]["lift.plant"]["parameters"]["start.x_L"] == 0.25
    cold, hot = (with_replacement.run(set={"lift.plant.Motor.Winding_K": k}) for k in (293.15, 393.15))
    assert np.abs(cold["lift.plant.i_q"] - hot["lift.plant.i_q"]).max() > 0.01


def test_resumed_run_has_the_same_metrics(with_replacement: ec.Simulation, tmp_path: Path) -> None:
    """The state of the metrics is in our units before and after."""
    full_run = with_replacement.run()
    with_replacement.run(stop_time=0.01, checkpoint=tmp_path / "half")
    parts = with_replacement.run(resume=tmp_path / "half")
    assert parts["lift.plant.x_L"][-1] == full_run["lift.plant.x_L"][-1]
    np.testing.assert_equal(parts.metrics["joints"], full_run.metrics["joints"])


@pytest.mark.parametrize(
    "tables",
    [
        '[replace]\n"lift.plant" = {{ fmu = "{fmu}", mapping = "{mapping}" }}\n',
        '[replace]\n"lift.plant" = "{fmu}"\n[mapping]\n"lift.plant" = "{mapping}"\n',
    ],
    ids=["one table", "two tables"],
)
def test_scenario_file_names_fmu_and_mapping(tables: str, foreign: ec.Scenario, foreign_plant: Path) -> None:
    text = 'system = "lift"\n' + tables.format(fmu=foreign_plant, mapping=FOREIGN_MAPPING)
    Path("my.toml").write_text(text, encoding="utf-8")
    assert ec.load("my.toml").options.replacements() == foreign.options.replacements()


# ---- packages ----------------------------------------------------------------------------------------


def test_package_gives_the_same_rows(package: Path, with_replacement: ec.Simulation) -> None:
    with ec.load(package).prepare() as simulation:
        assert same_bits(simulation.run(), with_replacement.run())
        other_start = simulation.run(set={"lift.plant.start.x_L": 0.25})
        assert other_start["lift.plant.x_L"][0] == pytest.approx(0.25, rel=1e-15)
        other_lead = simulation.run(set={"lift.plant.screw.lead": 0.0205})
    # in the package the lead has our name and is in m, while the FMU has it in mm
    lead = SsvParameter("lift.plant.screw.lead", "Real", 20.5, SiUnit("mm", (0, 1, 0, 0, 0, 0, 0, 0), 1e-3))
    Path("lead.ssv").write_bytes(format_parameter_set(ParameterSet("lead", (lead,))))
    with ec.load(package, parameters=["lead.ssv"]).prepare() as simulation:
        from_file = simulation.run()
    assert same_bits(from_file, other_lead)
    fmu = from_file.record["components"]["lift.plant"]["fmu"]
    assert Path(fmu).parts[-3:] == ("my.ssp", "resources", "ForeignPlant.fmu")


def test_components_of_packages_can_be_replaced(
    package: Path,
    foreign: ec.Scenario,
    with_replacement: ec.Simulation,
    foreign_plant: Path,
    fmu_folder: Path,
) -> None:
    """By the same FMU, which then has its own names, and in a package of our components."""
    full_run = with_replacement.run()
    with ec.load(package, replace={"lift.plant": foreign_plant}).prepare() as simulation:
        position = simulation.run()["lift.plant.Screw.Position_mm"]
    assert full_run["lift.plant.x_L"] == pytest.approx((position - 850.0) / 1e3, rel=1e-12)
    of_ours = ec.load("lift", fmus=fmu_folder).export("lift.ssp")
    options: Any = {"replace": foreign.options.replace, "stop_time": 0.02, "set": IDEAL}
    with ec.load(of_ours, **options).prepare() as simulation:
        assert same_bits(simulation.run(), full_run)


# ---- FMUs and mappings that do not match -------------------------------------------------------------


def load_replaced(fmu: Path, path: Path, fmus: Path) -> ec.Scenario:
    """The lift with this FMU and mapping in the place of its plant."""
    return ec.load("lift", replace={"lift.plant": ec.Replacement(fmu, path)}, stop_time=0.001, fmus=fmus)


def test_missing_mapping_gives_a_table_and_a_message(emla: Emla, foreign_plant: Path) -> None:
    result = emla("run", "lift", "--replace", f"lift.plant={foreign_plant}")
    assert sentence(result, 2).endswith(f"cannot replace lift.plant: {WITHOUT_MAPPING}")
    for row in (
        ["input", "F_L [N]", "", "is missing"],
        ["output", "x_measured [m]", "", "is missing"],
        ["parameter", "motor.R_s [Ohm]", "", "is left out"],
        ["input", "", "Load.Force_kN [kN]", "keeps its start value"],
    ):
        assert row in table_rows(result)
    assert not Path("results/lift/results.csv").exists()
    exported = emla("export", "lift", "my.ssp", "--replace", f"lift.plant={foreign_plant}")
    assert WITHOUT_MAPPING in sentence(exported, 2) and not Path("my.ssp").exists()


def test_parameters_without_a_mapping_are_left_out(foreign_plant: Path, fmu_folder: Path) -> None:
    path = edited(('<ssm:MappingEntry source="motor.R_s" target="Motor.Rs_mOhm"/>', ""))
    with load_replaced(foreign_plant, path, fmu_folder).prepare() as simulation:
        parameters = simulation.run().record["components"]["lift.plant"]["parameters"]
    assert "motor.R_s" not in parameters and "motor.L_q" in parameters


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<ssm:MappingEntry source="d_4" target="Inverter.DisturbanceUd_V"/>', "", "the input d_4 [V] is"),
        ('source="u_q"', 'source="uq"', "names 'uq', which EmlaPlant does not have"),
        ('target="Motor.Uq_V"', 'target="Motor.U"', "names 'Motor.U', which ForeignPlant does not have"),
        ('source="u_d"', 'source="u_q"', "maps 'u_q' twice"),
        ('target="Motor.Ud_V"', 'target="Motor.Uq_V"', "maps 'u_d' to 'Motor.Uq_V', which is already"),
        ("<ssc:LinearTransformation offset", "<ssc:Linear offset", "is not valid SSP"),
        ("</ssm:ParameterMapping>", "", "is not well-formed XML"),
        ('factor="-1"', 'factor="minus one"', "is not valid SSP"),
    ],
)
def test_mistake_in_a_mapping(old: str, new: str, words: str, foreign_plant: Path, fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match=re.escape(words)):
        load_replaced(foreign_plant, edited((old, new)), fmu_folder).prepare()


TABLE = '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/>'


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        # of the same FMU, so that all other variables match
        ("F_L d_2", "the input F_L [N] as d_2 [m/s2] has the units N and m/s2"),
        ("F_L x_L", "the input F_L [N] as x_L [m] is output, Real"),
        ("v_L motor.R_s", "the output v_L [m/s] as motor.R_s [Ohm] is parameter, Real"),
        ("i_q i_q <ssc:LinearTransformation factor='0'/>", "has a factor of 0, which cannot be inverted"),
        ("d_3 d_4", "the input d_4 [V] is missing; a mapping may help."),  # d_4 is our d_3 then
        (
            f"motor.N_p motor.N_p {TABLE}</ssc:IntegerMappingTransformation>",
            "has a IntegerMappingTransformation for 'motor.N_p'; only linear ones are supported",
        ),
    ],
)
def test_mapping_between_unlike_variables(entry: str, words: str, fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match=re.escape(words)):
        load_replaced(fmu_folder / "EmlaPlant/EmlaPlant.fmu", mapping(entry), fmu_folder).prepare()


def test_mapped_name_is_used_once(emla: Emla, fmu_folder: Path) -> None:
    """uncertainty.F_2 of the FMU is our gearbox.eta_GB then; without conversion, units may differ."""
    plant = f"lift.plant={fmu_folder}/EmlaPlant/EmlaPlant.fmu"
    replace = ("--replace", plant, "--mapping", "lift.plant=my.ssm")
    options = ("run", "lift", "--stop-time", "0.001", "--no-plots", "--show-fit", *replace)
    mapping("gearbox.eta_GB uncertainty.F_2")
    assert verdicts(emla(*options))["uncertainty.F_2"] == "is left out"
    mapping("motor.R_s motor.L_q", "motor.L_q motor.R_s", attributes='suppressUnitConversion="true"')
    output = verdicts(emla(*options))
    assert output["motor.R_s"] == output["motor.L_q"] == "fits"


def test_mapping_needs_a_replacement_and_a_file(emla: Emla, foreign_plant: Path) -> None:
    observer_option = ("--replace", f"lift.observer={foreign_plant}")
    for command in (("run", "lift"), ("export", "lift", "my.ssp"), ("run", "lift", *observer_option)):
        text = sentence(emla(*command, "--mapping", "lift.plant=my.ssm"), 2)
        assert "--mapping lift.plant=my.ssm needs --replace lift.plant=FILE.fmu." in text
    options = ("--replace", f"lift.plant={foreign_plant}", "--mapping", "lift.plant=gone.ssm")
    assert "the mapping 'gone.ssm' cannot be read: No such file" in sentence(emla("run", "lift", *options), 2)

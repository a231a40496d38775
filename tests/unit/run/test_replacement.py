"""Another FMU in the place of a component: same results, under our names and units, or one clear sentence."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from typer.testing import Result

from emla_cosim.base.units import SiUnit
from emla_cosim.ssp.documents.parameter_sets import format_parameter_set
from emla_cosim.ssp.documents.ssd_data import ParameterSet, SsvParameter
from tests.support.commands import Emla, sentence
from tests.support.paths import FOREIGN_MAPPING

FOREIGN = FOREIGN_MAPPING

IDEAL = ("--set", "lift.plant.sensor.resolution=0")
"""Rounding of the last digit would move a step of the encoder, and everything after it."""

TOLERANCE = 1e-9
"""Per largest value of a signal: rounding, and what the closed loop makes of it in 0.3 s."""

HEAT = ("lift.plant.motor.temperature_rise", "lift.plant.motor.load")
"""What the other plant does not model."""
WITHOUT_MAPPING = "the input F_L [N] is missing, and 12 more do not fit; a mapping may help."


def ran(emla: Emla, output: str, *arguments: str) -> Result:
    result = emla("run", *arguments, "--no-plots", "--output", output)
    assert result.exit_code == 0, result.output
    return result


def results(folder: str) -> polars.DataFrame:
    return polars.read_csv(f"{folder}/results.csv")


def record(folder: str) -> dict[str, Any]:
    return json.loads(Path(folder, "run.json").read_text())


def metrics(folder: str) -> dict[str, float]:
    """Figures that are numbers: a run may be too short for some, and their plant has no ranges."""
    found = json.loads(Path(folder, "metrics.json").read_text())["joints"]["lift"]
    return {name: value for name, value in found.items() if isinstance(value, float)}


def rows(result: Result) -> list[list[str]]:
    """The table of what fits: kind, ours, theirs and verdict."""
    lines = [line for line in result.output.splitlines() if line.startswith("│")]
    cells = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines]
    return [row for row in cells if len(row) == 4 and row[3] != ""]


def verdicts(result: Result) -> dict[str, str]:
    """Of our variables, or of theirs where we have none, without units."""
    return {re.sub(r" \[.*", "", ours or theirs): verdict for _, ours, theirs, verdict in rows(result)}


def too_far(found: polars.DataFrame, expected: polars.DataFrame, tolerance: float) -> dict[str, float]:
    """Signals that differ, per their largest value."""
    assert found.columns == expected.columns
    far = {}
    for name in expected.columns:
        ours, theirs = expected[name].to_numpy(), found[name].to_numpy()
        largest = np.abs(ours).max() or 1.0
        difference = np.abs(theirs - ours).max() / largest
        if not difference <= tolerance:
            far[name] = difference
    return far


def mapping(*entries: str, path: str = "my.ssm") -> str:
    """A mapping file; an entry is `source target` or `source target inner XML`."""
    lines = []
    for entry in entries:
        source, target, *inner = entry.split(" ", 2)
        attributes = f'source="{source}" target="{target}"'
        lines.append(f"<ssm:MappingEntry {attributes}>{''.join(inner)}</ssm:MappingEntry>")
    Path(path).write_text(
        '<ssm:ParameterMapping version="1.0"'
        ' xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"'
        ' xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">'
        f"{''.join(lines)}</ssm:ParameterMapping>",
        encoding="utf-8",
    )
    return path


# ---- our plant from another exporter ---------------------------------------------------------------


def test_an_fmu_with_the_same_names_gives_the_same_bits(emla: Emla, python_fmu_folder: Path) -> None:
    """And needs no table, unless somebody asks for it."""
    other = python_fmu_folder / "EmlaPlant" / "python" / "EmlaPlant.fmu"
    ran(emla, "ours", "study", "--stop-time", "0.02")
    replaced = ("study", "--stop-time", "0.02", "--replace", f"lift.plant={other}")
    result = ran(emla, "theirs", *replaced)
    assert Path("ours/results.csv").read_bytes() == Path("theirs/results.csv").read_bytes()
    assert rows(result) == []
    assert "EmlaPlant.fmu as lift.plant: all 55 variables match (--show-fit lists them)" in result.stderr
    shown = ran(emla, "theirs", *replaced, "--show-fit")
    assert rows(shown) == [["", "55 more", "", "same name and unit"]]
    assert "variables match" not in shown.stderr
    assert record("theirs")["components"]["lift.plant"]["fmu"] == str(other)
    assert record("theirs")["components"]["tilt.plant"]["fmu"] != str(other)


# ---- somebody else's plant -------------------------------------------------------------------------


@pytest.fixture
def foreign(foreign_plant: Path) -> tuple[str, ...]:
    """The options that put the foreign plant in the place of ours."""
    return ("--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={FOREIGN}")


@pytest.mark.parametrize(
    ("how", "tolerance"),
    [
        ("--algorithm gauss-seidel", TOLERANCE),
        ("--algorithm jacobi", TOLERANCE),
        ("--algorithm jacobi --no-kernel", TOLERANCE),
        ("--algorithm jacobi --extrapolation master", 10.0 * TOLERANCE),
        ("--algorithm strong --coupling-tolerance 1e-10", 100.0 * TOLERANCE),
    ],
)
def test_other_names_and_units_give_the_same_results(
    emla: Emla, foreign: tuple[str, ...], how: str, tolerance: float
) -> None:
    options = ("lift", "--stop-time", "0.3", *how.split(), *IDEAL)
    ran(emla, "ours", *options)
    ran(emla, "theirs", *options, *foreign)
    ours, theirs = results("ours"), results("theirs")
    # what they have and we do not comes last
    extra = [name for name in theirs.columns if name not in ours.columns]
    assert extra == ["lift.plant.Motor.IqError_A"]
    common = [name for name in ours.columns if name not in HEAT]
    assert too_far(theirs.select(common), ours.select(common), tolerance) == {}
    assert metrics("theirs") == pytest.approx(metrics("ours"), rel=1e-6)


def test_chosen_steps_are_the_same(emla: Emla, foreign: tuple[str, ...]) -> None:
    """Errors count relative to sizes and nominal values, whatever the unit; rounding moves steps a little."""
    options = ("lift", "--stop-time", "0.05", "--error-tolerance", "1e-3", *IDEAL)
    ran(emla, "ours", *options)
    ran(emla, "theirs", *options, *foreign)
    assert record("theirs")["stepping"]["steps"] == record("ours")["stepping"]["steps"]
    ours, theirs = results("ours"), results("theirs")
    common = [name for name in ours.columns if name not in HEAT]
    assert too_far(theirs.select(common), ours.select(common), 1e-4) == {}


def test_the_table_says_how_everything_is_converted(emla: Emla, foreign: tuple[str, ...]) -> None:
    result = ran(emla, "out", "lift", "--stop-time", "0.001", *foreign)
    table = rows(result)
    assert ["input", "F_L [N]", "Load.Force_kN [kN]", "x -0.001"] in table
    assert ["output", "x_measured [m]", "Sensor.Position_mm [mm]", "x 1000 + 850"] in table
    assert ["output", "i_q [A]", "Motor.Iq_A [A]", "fits"] in table
    assert ["parameter", "start.x_L [m]", "Screw.Start_mm [mm]", "x 1000 + 850"] in table
    assert ["output", "x_L [m]", "Screw.Position_mm [mm]", "x 1000 + 850"] in table
    assert ["parameter", "gearbox.eta_GB", "Gearbox.Efficiency_pct", "x 100"] in table
    assert ["output", "P_el [W]", "Motor.Power_kW [kW]", "x 0.001"] in table
    ours = [ours for _, ours, _, _ in table if ours]
    assert len(ours) == len(set(ours))
    mapped = record("out")["components"]["lift.plant"]["mapping"]
    assert mapped["x_L"] == "Screw.Position_mm = x_L x 1000 + 850"


def test_start_values_keep_our_names_and_units(emla: Emla, foreign: tuple[str, ...]) -> None:
    ran(emla, "out", "lift", "--stop-time", "0.001", *foreign, "--set", "lift.plant.start.x_L=0.25")
    assert results("out")["lift.plant.x_L"][0] == pytest.approx(0.25, rel=1e-15)
    assert record("out")["components"]["lift.plant"]["parameters"]["start.x_L"] == "0.25"


def test_their_own_parameters_keep_their_names(emla: Emla, foreign: tuple[str, ...]) -> None:
    """The temperature of the winding, which our plant does not have."""
    for kelvin in ("293.15", "393.15"):
        ran(
            emla,
            kelvin,
            "lift",
            "--stop-time",
            "0.05",
            *foreign,
            "--set",
            f"lift.plant.Motor.Winding_K={kelvin}",
        )
    cold, hot = results("293.15"), results("393.15")
    assert np.abs(cold["lift.plant.i_q"] - hot["lift.plant.i_q"]).max() > 0.01


def test_signals_are_chosen_by_our_names(emla: Emla, foreign: tuple[str, ...]) -> None:
    ran(emla, "out", "lift", "--stop-time", "0.001", *foreign, "--signals", "lift.plant.x_*")
    assert results("out").columns == ["time", "lift.plant.x_L", "lift.plant.x_measured"]


def test_pictures_are_drawn(emla: Emla, foreign: tuple[str, ...]) -> None:
    result = emla("run", "lift", "--stop-time", "0.01", "--output", "out", *foreign)
    assert result.exit_code == 0, result.output
    assert {p.name for p in Path("out").glob("*.png")} == {
        "tracking.png", "errors.png", "currents.png", "voltages.png", "torque.png", "observer.png",
        "power.png", "adaptation.png",
    }  # fmt: skip


def test_a_checkpoint_goes_on(emla: Emla, foreign: tuple[str, ...]) -> None:
    """The memory of the metrics and the rows of results.csv are in our units on both sides."""
    ran(emla, "whole", "lift", "--stop-time", "0.02", *IDEAL, *foreign, "--checkpoint", "unused")
    ran(emla, "parts", "lift", "--stop-time", "0.01", *IDEAL, *foreign, "--checkpoint", "half")
    ran(
        emla,
        "parts",
        "lift",
        "--stop-time",
        "0.02",
        *IDEAL,
        *foreign,
        "--resume",
        "half",
        "--checkpoint",
        "end",
    )
    assert Path("whole/results.csv").read_bytes() == Path("parts/results.csv").read_bytes()
    assert metrics("whole") == metrics("parts")


@pytest.mark.parametrize(
    "tables",
    [
        '[replace]\n"lift.plant" = {{ fmu = "{fmu}", mapping = "{mapping}" }}\n',
        '[replace]\n"lift.plant" = "{fmu}"\n[mapping]\n"lift.plant" = "{mapping}"\n',
    ],
    ids=["in one", "apart"],
)
def test_a_scenario_file_does_the_same(
    tables: str, emla: Emla, foreign: tuple[str, ...], foreign_plant: Path
) -> None:
    ran(emla, "options", "lift", "--stop-time", "0.02", *IDEAL, *foreign)
    Path("my.toml").write_text(
        'system = "lift"\nstop_time = 0.02\n[set]\n"lift.plant.sensor.resolution" = 0\n'
        + tables.format(fmu=foreign_plant, mapping=FOREIGN),
        encoding="utf-8",
    )
    ran(emla, "file", "my.toml")
    assert Path("file/results.csv").read_bytes() == Path("options/results.csv").read_bytes()


def test_a_package_does_the_same(emla: Emla, foreign: tuple[str, ...]) -> None:
    """Its connections carry the factors, its parameters the mapping."""
    ran(emla, "options", "lift", "--stop-time", "0.02", *IDEAL, *foreign)
    exported = emla("export", "lift", "my.ssp", "--stop-time", "0.02", *IDEAL, *foreign)
    assert exported.exit_code == 0, exported.output
    ran(emla, "package", "my.ssp")
    assert Path("package/results.csv").read_bytes() == Path("options/results.csv").read_bytes()
    ran(emla, "set", "my.ssp", "--set", "lift.plant.start.x_L=0.25")
    assert results("set")["lift.plant.x_L"][0] == pytest.approx(0.25, rel=1e-15)


def test_parameter_files_know_the_units_of_a_packed_replacement(emla: Emla, foreign: tuple[str, ...]) -> None:
    """In the package the lead has our name and is in m, while the FMU has it in mm."""
    assert emla("export", "lift", "my.ssp", "--stop-time", "0.02", *IDEAL, *foreign).exit_code == 0
    lead = SsvParameter("lift.plant.screw.lead", "Real", 20.5, SiUnit("mm", (0, 1, 0, 0, 0, 0, 0, 0), 1e-3))
    Path("lead.ssv").write_bytes(format_parameter_set(ParameterSet("lead", (lead,))))
    ran(emla, "file", "my.ssp", "--parameters", "lead.ssv")
    ran(emla, "set", "my.ssp", "--set", "lift.plant.screw.lead=0.0205")
    assert Path("file/results.csv").read_bytes() == Path("set/results.csv").read_bytes()
    fmus = {name: component["fmu"] for name, component in record("file")["components"].items()}
    assert fmus["lift.plant"] == "my.ssp/resources/ForeignPlant.fmu"


def test_a_replacement_in_a_package_can_be_replaced_by_itself(
    emla: Emla, foreign: tuple[str, ...], foreign_plant: Path
) -> None:
    """What it was given by our names, it keeps."""
    exported = emla("export", "lift", "my.ssp", "--stop-time", "0.02", *IDEAL, *foreign)
    assert exported.exit_code == 0, exported.output
    ran(emla, "package", "my.ssp")
    ran(emla, "again", "my.ssp", "--replace", f"lift.plant={foreign_plant}")
    ours, theirs = results("package"), results("again")
    position = theirs["lift.plant.Screw.Position_mm"].to_numpy()
    assert ours["lift.plant.x_L"].to_numpy() == pytest.approx((position - 850.0) / 1e3, rel=1e-12)


def test_a_component_of_a_package_can_be_replaced(emla: Emla, foreign: tuple[str, ...]) -> None:
    ran(emla, "options", "lift", "--stop-time", "0.02", *IDEAL, *foreign)
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    ran(emla, "package", "lift.ssp", "--stop-time", "0.02", *IDEAL, *foreign)
    assert Path("package/results.csv").read_bytes() == Path("options/results.csv").read_bytes()


# ---- what does not fit -----------------------------------------------------------------------------


def test_without_a_mapping_there_is_a_table_and_a_sentence(emla: Emla, foreign_plant: Path) -> None:
    result = emla("run", "lift", "--replace", f"lift.plant={foreign_plant}")
    assert sentence(result, 2).endswith(f"cannot replace lift.plant: {WITHOUT_MAPPING}")
    table = rows(result)
    assert ["input", "F_L [N]", "", "is missing"] in table
    assert ["output", "x_measured [m]", "", "is missing"] in table
    assert ["parameter", "motor.R_s [Ohm]", "", "is left out"] in table
    assert ["parameter", "start.x_L [m]", "", "is left out"] in table
    assert ["input", "", "Load.Force_kN [kN]", "keeps its start value"] in table
    assert not Path("results/lift/results.csv").exists()


def edited(*changes: tuple[str, str]) -> tuple[str, str]:
    """The option with the mapping of the foreign plant after some changes."""
    text = FOREIGN.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path("my.ssm").write_text(text, encoding="utf-8")
    return "--mapping", "lift.plant=my.ssm"


def test_parameters_that_are_left_out_are_shown_and_the_run_goes_on(
    emla: Emla, foreign: tuple[str, ...]
) -> None:
    entry = '<ssm:MappingEntry source="motor.R_s" target="Motor.Rs_mOhm"/>'
    result = ran(emla, "out", "lift", "--stop-time", "0.001", *foreign[:2], *edited((entry, "")))
    assert verdicts(result)["motor.R_s"] == "is left out"
    assert verdicts(result)["motor.L_q"] == "x 1000"
    assert "motor.R_s" not in record("out")["components"]["lift.plant"]["parameters"]


def test_an_input_that_nothing_drives_is_shown(emla: Emla, foreign: tuple[str, ...]) -> None:
    """Two of ours cannot drive one of theirs, so an input that is not mapped is not driven."""
    entry = '<ssm:MappingEntry source="d_4" target="Inverter.DisturbanceUd_V"/>'
    result = emla("run", "lift", *foreign[:2], *edited((entry, "")))
    assert "the input d_4 [V] is missing; a mapping may help." in sentence(result, 2)
    assert ["input", "", "Inverter.DisturbanceUd_V [V]", "keeps its start value"] in rows(result)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('source="u_q"', 'source="uq"', "names 'uq', which EmlaPlant does not have"),
        ('target="Motor.Uq_V"', 'target="Motor.U"', "names 'Motor.U', which ForeignPlant does not have"),
        ('source="u_d"', 'source="u_q"', "maps 'u_q' twice"),
        (
            'target="Motor.Ud_V"',
            'target="Motor.Uq_V"',
            "maps 'u_d' to 'Motor.Uq_V', which is already the target of 'u_q'",
        ),
        ('target="Load.Force_kN"', 'target="Screw.Mass_kg"', "maps 'screw.M_BS' to 'Screw.Mass_kg', which"),
        ("<ssc:LinearTransformation offset", "<ssc:Linear offset", "is not valid SSP"),
        ("</ssm:ParameterMapping>", "", "is not well-formed XML"),
        ('factor="-1"', 'factor="minus one"', "is not valid SSP"),
    ],
)
def test_a_mapping_that_is_wrong_is_explained(
    emla: Emla, foreign: tuple[str, ...], old: str, new: str, words: str
) -> None:
    text = sentence(emla("run", "lift", *foreign[:2], *edited((old, new))), 2)
    assert "my.ssm'" in text and words in text


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        # of the same FMU, so that all the rest fits
        ("F_L d_2", "the input F_L [N] as d_2 [m/s2] has the units N and m/s2"),
        ("F_L x_L", "the input F_L [N] as x_L [m] is output, Real"),
        ("v_L motor.R_s", "the output v_L [m/s] as motor.R_s [Ohm] is parameter, Real"),
        ("i_q i_q <ssc:LinearTransformation factor='0'/>", "has a factor of 0, which cannot be inverted"),
        ("motor.R_s motor.L_d", "the parameter motor.R_s [Ohm] as motor.L_d [H] has the units Ohm and H"),
    ],
)
def test_what_does_not_fit_is_named(emla: Emla, fmu_folder: Path, entry: str, words: str) -> None:
    own = f"lift.plant={fmu_folder}/EmlaPlant/EmlaPlant.fmu"
    result = emla("run", "lift", "--replace", own, "--mapping", f"lift.plant={mapping(entry)}")
    assert words in sentence(result, 2)


def test_a_name_is_given_once(emla: Emla, fmu_folder: Path) -> None:
    """What is called d_4 there is our d_3 then, and our d_4 has no counterpart."""
    own = ("--replace", f"lift.plant={fmu_folder}/EmlaPlant/EmlaPlant.fmu", "--mapping", "lift.plant=my.ssm")
    mapping("d_3 d_4")
    assert "the input d_4 [V] is missing; a mapping may help." in sentence(emla("run", "lift", *own), 2)
    mapping("gearbox.eta_GB uncertainty.F_2")
    result = ran(emla, "out", "lift", "--stop-time", "0.001", *own)
    assert verdicts(result)["uncertainty.F_2"] == "is left out"
    assert emla("export", "lift", "my.ssp", "--stop-time", "0.001", *own).exit_code == 0
    ran(emla, "package", "my.ssp")
    assert Path("package/results.csv").read_bytes() == Path("out/results.csv").read_bytes()


def test_units_that_shall_not_be_converted(emla: Emla, fmu_folder: Path) -> None:
    """suppressUnitConversion: the transformation is all there is, whatever the units."""
    text = mapping("motor.R_s motor.L_q", "motor.L_q motor.R_s")
    changed = Path(text).read_text().replace("source=", 'suppressUnitConversion="true" source=')
    Path(text).write_text(changed)
    own = f"lift.plant={fmu_folder}/EmlaPlant/EmlaPlant.fmu"
    result = ran(
        emla, "out", "lift", "--stop-time", "0.001", "--replace", own, "--mapping", f"lift.plant={text}",
        "--show-fit",
    )  # fmt: skip
    assert verdicts(result)["motor.R_s"] == verdicts(result)["motor.L_q"] == "fits"


def test_tables_of_values_are_for_packages(emla: Emla, fmu_folder: Path) -> None:
    table = '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/>'
    entry = mapping(f"motor.N_p motor.N_p {table}</ssc:IntegerMappingTransformation>")
    own = f"lift.plant={fmu_folder}/EmlaPlant/EmlaPlant.fmu"
    text = sentence(emla("run", "lift", "--replace", own, "--mapping", f"lift.plant={entry}"), 2)
    assert "has a IntegerMappingTransformation for 'motor.N_p'; only linear ones are supported" in text


@pytest.mark.parametrize("command", [("run", "lift"), ("export", "lift", "my.ssp")])
def test_a_mapping_needs_a_replacement(emla: Emla, command: tuple[str, ...], foreign_plant: Path) -> None:
    text = sentence(emla(*command, "--mapping", "lift.plant=my.ssm"), 2)
    assert "--mapping lift.plant=my.ssm needs --replace lift.plant=FILE.fmu." in text
    other = ("--replace", f"lift.observer={foreign_plant}")
    assert "needs --replace lift.plant" in sentence(
        emla(*command, *other, "--mapping", "lift.plant=my.ssm"), 2
    )


def test_a_mapping_that_is_not_there(emla: Emla, foreign: tuple[str, ...]) -> None:
    text = sentence(emla("run", "lift", *foreign[:2], "--mapping", "lift.plant=gone.ssm"), 2)
    assert "the mapping 'gone.ssm' cannot be read: No such file" in text


def test_a_package_is_not_written_where_something_does_not_fit(emla: Emla, foreign_plant: Path) -> None:
    result = emla("export", "lift", "my.ssp", "--replace", f"lift.plant={foreign_plant}")
    assert WITHOUT_MAPPING in sentence(result, 2)
    assert not Path("my.ssp").exists()

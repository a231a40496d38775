"""Systems of machine files: what they contain, three modes that agree, and messages for what does not fit."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.recorders.metrics import default_roles
from emla_cosim.study.joint import ideal_sensors
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.loading import load
from emla_cosim.study.machines.machine_file import MachineFile, load_machine_file, parse_machine_file
from emla_cosim.study.machines.machine_info import find_machine
from emla_cosim.study.machines.systems import build_machine_system
from emla_cosim.study.roles import find_element, find_joints, find_variable
from machine_fmu.model import MachineModel
from machine_fmu.spline import DEFAULT_FILE
from tests.support.tiers import mostly_slow

BOOM = """
kind = "machine"
description = "A boom"
dimensions = 2
ground.points.foot = [0.4, -0.5]

[bodies.boom]
joint = "revolute"
assembly = "30 deg"
m = "120 kg"
c = [1.0, 0.0]
J = 30.0
points = { pin = [0.6, 0.1] }

[actuators.luff]
joint = "lift"
from = "ground.foot"
to = "boom.pin"
length = 0.5
start = 0.2

[motion]
times = [0, "4 s"]
strokes.luff = [0.2, 0.3]
"""


def boom(old: str = "", new: str = "", folder: Path = Path()) -> MachineFile:
    assert old in BOOM
    return parse_machine_file(
        tomllib.loads(BOOM.replace(old, new)), "the machine 'boom.toml'", "boom", folder
    )


# ---- files -------------------------------------------------------------------------------------------


def test_joint_gives_what_the_machine_leaves_out() -> None:
    actuator, sheet = boom().machine.actuators["luff"], load_joint("lift").emla
    assert (actuator.m, actuator.stroke) == (sheet.M_BS, (sheet.q_LB, sheet.q_UB))
    assert boom().joints["luff"].name == "luff"


def test_machine_overrides_its_joint() -> None:
    file = boom('joint = "lift"', 'joint = "lift"\nm = "90 kg"\nstroke = [0.1, 0.4]')
    emla = file.joints["luff"].emla
    assert (emla.M_BS, emla.q_LB) == (90.0, 0.1) and emla.q_UB == pytest.approx(0.4)
    assert file.joints["luff"].realistic.emla.M_BS == 90.0


def test_assembly_pose_beyond_a_stroke_is_no_start() -> None:
    """Nothing moves the machine into its stroke. With a motion, it starts where this begins."""
    text = BOOM.replace("start = 0.2", "stroke = [0.0, 0.1]").partition("[motion]")[0]
    with pytest.raises(CommandError, match=r"'luff' at 0\.\d+ m, as assembled.*stroke is 0 to 0\.1 m; write"):
        parse_machine_file(tomllib.loads(text), "the machine 'boom.toml'", "boom", Path())
    with_motion = text + '[motion]\ntimes = [0, "4 s"]\nstrokes.luff = [0.02, 0.09]\n'
    parse_machine_file(tomllib.loads(with_motion), "the machine 'boom.toml'", "boom", Path())


def test_machine_file_of_any_name(tmp_path: Path) -> None:
    path = tmp_path / "3 dof-boom.ü.toml"
    path.write_text(BOOM, encoding="utf-8")
    models = {component.name: str(component.model) for component in load(path).system.components}
    assert models["machine.manipulator"].endswith(":Machine3DofBoomLoad")


def test_joint_file_beside_the_machine(tmp_path: Path) -> None:
    text = (Path(ec.__file__).parent / "study/joints/tilt.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace('M_BS = "83.6 kg"', 'M_BS = "70 kg"'))
    assert boom('"lift"', '"mine.toml"', tmp_path).joints["luff"].emla.M_BS == 70.0


def test_motion_rests_at_its_strokes() -> None:
    motion = boom().motion
    assert motion is not None
    spline = motion.spline
    for order, expected in ((0, [0.2, 0.3]), (1, [0.0, 0.0]), (2, [0.0, 0.0])):
        assert spline.evaluated([0.0, 4.0], order)[:, 0] == pytest.approx(expected, abs=1e-12)
    assert motion.travel("luff", 0.0, 4.0)[2] == pytest.approx(1.875 * 0.1 / 4.0, rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('joint = "lift"', "", "[actuators.luff] of the machine 'boom.toml' has neither stroke nor joint"),
        ('joint = "lift"', "stroke = [0.0, 0.5]", "has no 'joint'; to run the machine, write joint ="),
        ('"lift"', '"lifts"', "'joint' in [actuators.luff] of the machine 'boom.toml' is 'lifts'; it must"),
        ('"lift"', '"none.toml"', "the joint 'none.toml' cannot be read"),
        ('[0, "4 s"]', "[0, 4, 3]", "each time must be after the one before"),
        ('[0, "4 s"]', "[0, 2, 4]", "[motion.strokes] of the machine 'boom.toml' has 2 strokes for 3"),
        ("strokes.luff", "strokes.tilt", "has tilt; the actuators are luff."),
        ("[0.2, 0.3]", "[0.2, 0.9]", "moves 'luff' from 0.2 to 0.9 m, but its stroke is 0 to 0.522 m."),
        ('"4 s"', '"1 s"', "make its times 1.38 times as long."),
        (
            "times =",
            'file = "x.json"\ntimes =',
            "has a file, and also times or strokes; remove one or the other.",
        ),
        ("[motion]", "[run]\nstop = 3\n[motion]", "has the unknown entry 'stop'"),
        ('kind = "machine"', 'kind = "joint"', "is not a machine file; it lacks kind"),
        ("actuators.luff", "actuators.machine", "an actuator cannot be called 'machine'"),
    ],
)
def test_wrong_files(old: str, new: str, expected: str) -> None:
    with pytest.raises(CommandError) as error:
        boom(old, new)
    assert expected in str(error.value)


def test_joints_that_share_a_file_have_their_own_random_numbers() -> None:
    seeds = [joint.seed for joint in load_machine_file("stewart").joints.values()]
    assert len(set(seeds)) == 6 and load_joint("lift").seed == boom().joints["luff"].seed


# ---- systems -----------------------------------------------------------------------------------------


MACHINES = ("crane", "lift_table", "stewart")


def run(name: str, mode: str, fmus: Path, stop_time: float = 0.02) -> ec.Result:
    scenario = load(name, mode=mode, stop_time=stop_time, output_interval=1e-3)
    ideal = ideal_sensors(scenario.system)
    quiet = {
        f"{c.name}.d_2.{term}": 0.0
        for c in scenario.system.components
        if c.name.endswith(".disturbance")
        for term in ("amplitude[1]", "amplitude[2]", "arctan", "high", "low")
    }
    with scenario.prepare(fmus=fmus) as simulation:
        return simulation.run(set={**ideal, **quiet}, extrapolation="fmu" if mode != "replayed" else "none")


def column(result: ec.Result, role: str) -> Vector:
    names = [find_variable(joint, role, result.names, result.roles) for joint in result.metrics["joints"]]
    return np.column_stack([np.asarray(result[str(name)]) for name in names])


@pytest.mark.parametrize("name", mostly_slow(MACHINES, ["crane", "lift_table"]))
def test_modes_agree(name: str, fmu_folder: Path) -> None:
    coupled, merged, replay_run = (run(name, mode, fmu_folder) for mode in ("coupled", "merged", "replayed"))
    joints = list(load_machine_file(name).joints)
    assert all(list(result.metrics["joints"]) == joints for result in (coupled, merged, replay_run))
    x, merged_positions = column(coupled, "x_L"), column(merged, "x_L")
    assert x == pytest.approx(merged_positions, abs=1e-7)
    assert column(coupled, "F_L") == pytest.approx(column(merged, "F_L"), rel=1e-3, abs=20.0)
    model = find_machine(replay_run)
    assert isinstance(model, MachineModel) and model.names == tuple(joints)
    motion = [column(replay_run, role) for role in ("x_d", "v_d", "a_d")]
    if not model.mechanism.passive:  # the model holds what swings
        forces = model.forces(*motion)
        assert column(replay_run, "F_L") == pytest.approx(forces, rel=1e-6, abs=1e-3)


@pytest.mark.parametrize("name", ["crane", "excavator", "lift_table", "stewart", "hdrm-merged"])
def test_joints_and_their_elements(name: str) -> None:
    system = load(name).system
    joints = find_joints(system)
    file = load_machine_file("hdrm" if name.startswith("hdrm") else name)
    assert joints == list(file.joints)
    roles = default_roles(map(str, system.connections))
    assert [find_element(joint, roles) for joint in joints] == list(range(1, len(joints) + 1))


def test_what_swings_hangs_at_the_start(fmu_folder: Path, tmp_path: Path) -> None:
    """Also where the motion starts in another pose than the file."""
    strokes = load_machine_file("crane").start | {"luff": 0.45}
    coefficients = {name: [x, x] for name, x in strokes.items()}
    spline = {"degree": 1, "knots": [0, 0, 1, 1], "coefficients": coefficients}
    (tmp_path / "up.json").write_text(json.dumps(spline))
    scenario = load("crane", trajectory=tmp_path / "up.json", stop_time=0.05)
    with scenario.prepare(fmus=fmu_folder) as simulation:
        result = simulation.run(set=ideal_sensors(scenario.system))
    assert np.asarray(result["luff.plant.x_L"])[0] == 0.45
    assert np.abs(np.asarray(result["machine.manipulator.passive.v[1]"])).max() < 0.05  # it would be 5 rad/s


def test_defaults_and_what_overrides_them(tmp_path: Path) -> None:
    path = tmp_path / "boom.toml"
    path.write_text(BOOM)
    options = load(path).options
    assert (options.stop_time, options.step_size, options.gains) == (4.0, 1e-4, "damped")
    assert options.algorithm == "strong" and options.class_options["step_multiples"]["luff.observer"] == 1
    assert load(path, mode="replayed").options.algorithm == "gauss-seidel"
    path.write_text(BOOM + '[run]\nmode = "merged"\nstop_time = "2 s"\ngains = "robust"\n')
    scenario = load(path)
    assert (scenario.options.stop_time, scenario.options.gains) == (2.0, "robust")
    assert "machine.plant" in [c.name for c in scenario.system.components]
    assert load(path, mode="coupled").system.bonds.keys() == {"luff"}


def test_machine_without_motion_holds_its_start(tmp_path: Path, fmu_folder: Path) -> None:
    path = tmp_path / "boom.toml"
    path.write_text(BOOM.partition("[motion]")[0])
    scenario = load(path, stop_time=0.4)
    (trajectory,) = (c for c in scenario.system.components if c.name == "machine.trajectory")
    assert trajectory.note == f"the machine file '{path}' has no [motion]; its actuators hold their start."
    with scenario.prepare(fmus=fmu_folder) as simulation:
        result = simulation.run()
    assert result.metrics["joints"]["luff"]["held"]
    assert np.asarray(result["machine.trajectory.x_d[1]"]) == pytest.approx(0.2)


def test_models_have_the_mass_of_the_machine() -> None:
    """Gains act as on the machine of their joint: inertia of model over that of drive and machine."""
    sheet = load_joint("lift")
    drive, tuned = sheet.emla.alpha_RL * sheet.emla.A_eq, sheet.compliant_load.mass
    file = boom('m = "120 kg"', 'm = "2 t"')
    model = MachineModel(file.machine)
    poses = np.array([[0.2], [0.3]])
    rest = np.zeros_like(poses)
    mass = np.max(model.forces(poses, rest, rest + 1.0) - model.forces(poses, rest, rest))
    for mode, factor in (("coupled", (drive + mass) / (drive + tuned)), ("replayed", 1.0)):
        system = build_machine_system(file, None, None, mode=mode)
        for name in ("luff.controller", "luff.observer"):
            inertia = system.component(name).parameters["model.A_eq"]
            assert inertia == pytest.approx(sheet.emla.A_eq * factor, rel=1e-3)


def test_models_of_the_paper_have_the_drive_alone() -> None:
    for joint in ("lift", "tilt", "telescope"):
        parameters = load("hdrm-coupled").system.component(f"{joint}.controller").parameters
        assert parameters["model.A_eq"] == load_joint(joint).emla.A_eq


def test_disturbances_of_built_in_joints_are_those_of_the_paper(tmp_path: Path) -> None:
    text = (Path(ec.__file__).parent / "study/joints/tilt.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text)
    for joint, disturbed in (
        ('"lift"', False),
        ('"lift"\ndisturbances = true', True),
        ('"mine.toml"', True),
        ('"mine.toml"\ndisturbances = false', False),
    ):
        system = build_machine_system(boom('"lift"', joint, tmp_path), None, "compensated")
        amplitude = system.component("luff.disturbance").parameters.get("d_2.amplitude[1]", 0.0)
        assert bool(amplitude) == disturbed


@pytest.mark.parametrize(
    ("source", "options", "expected"),
    [
        ("study", {"mode": "merged"}, "'study' has no modes; --mode is for machine files"),
        ("crane", {"mode": "both"}, "there is no mode 'both'; choose from coupled, replayed and merged."),
        ("crane", {"notch": {"lift": 5.0}}, "the joint 'lift' of a notch does not exist"),
        ("crane", {"trajectory": DEFAULT_FILE}, "the coefficients are of ['lift', 'tilt', 'telescope']"),
    ],
)
def test_options_that_do_not_fit(source: str, options: dict[str, Any], expected: str) -> None:
    with pytest.raises(CommandError) as error:
        load(source, **options)
    assert expected in str(error.value)


def test_entries_of_data_sheets() -> None:
    scenario = load("crane", sheet={"luff.screw.lead": "10 mm"})
    assert scenario.system.component("luff.plant").parameters["screw.lead"] == 0.01


# ---- other ways to run a machine -----------------------------------------------------------------------


def test_run_goes_on_from_a_checkpoint(fmu_folder: Path, tmp_path: Path) -> None:
    with load("lift_table", stop_time=0.02).prepare(fmus=fmu_folder) as simulation:
        uninterrupted = simulation.run()
        simulation.run(stop_time=0.01, checkpoint=tmp_path / "c", overwrite=True)
        rest = simulation.run(resume=tmp_path / "c")
    assert rest["lift.plant.x_L"][-1] == uninterrupted["lift.plant.x_L"][-1]


def test_package_of_a_machine_is_the_same_system(fmu_folder: Path, tmp_path: Path) -> None:
    with load("crane", stop_time=0.01).prepare(fmus=fmu_folder) as simulation:
        expected = simulation.run()
    crane = load("crane")
    options: dict[str, Any] = {"step_multiples": dict(crane.options.class_options["step_multiples"])}
    package = crane.export(tmp_path / "crane.ssp", fmus=fmu_folder)
    with load(package, stop_time=0.01, algorithm="strong", **options).prepare() as simulation:
        result = simulation.run()
    assert list(result.metrics["joints"]) == ["luff", "fold", "telescope"]
    assert column(result, "x_L") == pytest.approx(column(expected, "x_L"), abs=1e-12)


def test_record_has_the_machine(fmu_folder: Path) -> None:
    with load("crane", stop_time=1e-3).prepare(fmus=fmu_folder) as simulation:
        result = simulation.run(set={"machine.manipulator.boom.m": 300.0})
    record = json.loads(json.dumps(result.record["machine"]))
    assert record["name"] == "crane"
    assert set(record["definition"]["actuators"]) == {"luff", "fold", "telescope"}
    model = find_machine(result)
    assert model is not None and model.machine.parameters["boom.m"].value == 300.0

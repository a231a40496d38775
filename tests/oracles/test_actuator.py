"""Start values of an actuator follow from its data sheet; invalid sheets give one error message.

The motor is Tolomatic's MV43, of a family that the paper does not have; the file says where it is from.
"""

import copy
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.analyses.variants.factors import format_arguments
from emla_cosim.run.run_record import to_plain
from emla_cosim.run.scenarios.scenario import Scenario
from emla_cosim.study.actuator.entries import TABLES
from tests.support.commands import Emla
from tests.support.paths import ROOT
from tests.support.scenario_runs import run_scenario

FILE = ROOT / "docs/actuator.toml"
SHEET: dict[str, Any] = tomllib.loads(FILE.read_text(encoding="utf-8"))

# The same motor, with everything that an actuator can have: number and unit by table.key
MORE = {
    "motor.B_m": (0.03, "N m/krpm"),
    "motor.tau_max": (24.0, "N m"),
    "motor.tau_N": (8.2, "N m"),
    "coupling.J_c": (0.4, "kg cm^2"),
    "screw.q_LB": (-20.0, "mm"),
    "screw.v_max": (110.0, "mm/s"),
    "inverter.delay": (1.0, "ms"),
    "inverter.dead_time": (0.4, "us"),
    "inverter.f_PWM": (8.0, "kHz"),
    "inverter.i_0": (0.2, "A rms"),
    "sensor.sigma": (10.0, "nm"),
    "sensor.sigma_i": (20.0, "mA peak"),
    "sensor.resolution_i": (10.0, "mA peak"),
    "friction.F_C": (200.0, "N"),
    "friction.F_S": (300.0, "N"),
    "friction.v_S": (5.0, "mm/s"),
    "friction.v_0": (0.05, "mm/s"),
    "friction.eta_back": (0.7, ""),
    "stop.stiffness": (2e8, "N/m^2"),
    "stop.damping": (5.0, "s/m"),
    "thermal.tau_th": (20.0, "min"),
    "thermal.permitted_rise": (100.0, "K"),
    "control.k_1": (0.04, ""),
    "control.k_2": (0.08, ""),
    "control.observer": (0.25, ""),
}
MV43 = {
    "motor.poles": (8, ""),
    "motor.kT": (1.693717, "N m/A rms"),
    "motor.K_E": (108.258, "V/krpm rms line to line"),
    "motor.R": (2.32, "Ohm line to line"),
    "motor.L": (11.5, "mH line to line"),
    "motor.J_m": (9.60209, "kg cm^2"),
    "motor.i_N": (5.0, "A rms"),
    "motor.i_max": (15.0, "A rms"),
    "motor.n_max": (3500.0, "rpm"),
    "gearbox.ratio": (5.0, ""),
    "gearbox.efficiency": (95.0, "%"),
    "gearbox.J_GB": (0.8, "kg cm^2"),
    "screw.lead": (10.0, "mm"),
    "screw.efficiency": (0.85, ""),
    "screw.M_BS": (60.0, "kg"),
    "screw.J_BS": (3.2, "kg cm^2"),
    "screw.B_BS": (150.0, "N s/m"),
    "screw.stroke": (400.0, "mm"),
    "inverter.U_supply": (460.0, "V rms line to line"),
    "inverter.i_max": (18.0, "A rms"),
    "sensor.bits": (20, ""),
}
T_S, LOAD = 1e-3, 20e3  # of the prototype


def sheet(numbers: Mapping[str, tuple[float, str]]) -> dict[str, dict[str, Any]]:
    """Tables of an actuator with these numbers."""
    tables: dict[str, dict[str, Any]] = {}
    for entry, (number, unit) in numbers.items():
        table, key = entry.split(".")
        tables.setdefault(table, {})[key] = f"{number!r} {unit}" if unit else number
    return tables


def expected(n: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """All that follows from the numbers of a sheet, by the closed forms: parameters by component."""
    p = n["motor.poles"] / 2
    flux = n["motor.kT"] / math.sqrt(2) / (1.5 * p)
    radius = n["screw.lead"] * 1e-3 / n["gearbox.ratio"] / (2 * math.pi)  # travel per angle of the motor
    i_max = math.sqrt(2) * min(n["motor.i_max"], n["inverter.i_max"])
    torque = min(1.5 * p * flux * i_max, n.get("motor.tau_max", math.inf))
    J_c = (n.get("coupling.J_c", 0.0) + n["screw.J_BS"] / n["gearbox.ratio"] ** 2) * 1e-4
    J = (n["motor.J_m"] + n["gearbox.J_GB"]) * 1e-4 + J_c
    B_m = n.get("motor.B_m", 0.0) * 60 / (2000 * math.pi)
    A_eq, B_eq = J / radius + n["screw.M_BS"] * radius, B_m / radius + n["screw.B_BS"] * radius
    v_max = min(n["motor.n_max"] * 2 * math.pi / 60 * radius, n.get("screw.v_max", math.inf) * 1e-3)
    efficiency = n["gearbox.efficiency"] / 100 * n["screw.efficiency"]
    u_max = n["inverter.U_supply"] * math.sqrt(2 / 3)
    q_LB = n.get("screw.q_LB", 0.0) * 1e-3
    winding = {"R_s": n["motor.R"] / 2, "L_d": n["motor.L"] / 2e3, "L_q": n["motor.L"] / 2e3}
    winding |= {"Phi_PM": flux, "N_p": p}
    plant = {
        **{f"motor.{name}": value for name, value in winding.items()},
        "motor.J_m": n["motor.J_m"] * 1e-4,
        "motor.B_m": B_m,
        "motor.i_max": 1.5 * torque / (1.5 * p * flux),
        "coupling.J_c": J_c,
        "gearbox.rho": 1 / n["gearbox.ratio"],
        "gearbox.J_GB": n["gearbox.J_GB"] * 1e-4,
        "gearbox.eta_GB": efficiency,
        "screw.lead": n["screw.lead"] * 1e-3,
        "screw.M_BS": n["screw.M_BS"],
        "screw.B_BS": n["screw.B_BS"],
        "screw.q_LB": q_LB,
        "screw.q_UB": q_LB + n["screw.stroke"] * 1e-3,
        "screw.v_max": v_max,
        "inverter.u_max": u_max,
        "sensor.resolution": 2 * math.pi * radius / 2 ** n["sensor.bits"],
    }
    si = {
        "inverter.delay": ("inverter.delay", 1e-3),
        "inverter.dead_time": ("inverter.dead_time", 1e-6),
        "inverter.f_PWM": ("inverter.f_PWM", 1e3),
        "inverter.i_0": ("inverter.i_0", math.sqrt(2)),
        "sensor.sigma": ("sensor.sigma", 1e-9),
        "sensor.sigma_i": ("sensor.current.sigma", 1e-3),
        "sensor.resolution_i": ("sensor.current.resolution", 1e-3),
        "friction.F_C": ("friction.F_C", 1.0),
        "friction.F_S": ("friction.F_S", 1.0),
        "friction.v_S": ("friction.v_S", 1e-3),
        "friction.v_0": ("friction.v_0", 1e-3),
        "friction.eta_back": ("gearbox.eta_back", 1.0),
        "stop.stiffness": ("stop.stiffness", 1.0),
        "stop.damping": ("stop.damping", 1.0),
        "thermal.tau_th": ("motor.tau_th", 60.0),
        "thermal.permitted_rise": ("motor.permitted_rise", 1.0),
    }
    plant |= {name: n[entry] * factor for entry, (name, factor) in si.items() if entry in n}
    if "thermal.tau_th" in n:
        plant["motor.i_N"] = math.sqrt(2) * n["motor.i_N"]
    spare_torque = max(torque - LOAD * radius / efficiency, 0.1 * torque)
    controller = {
        **{f"model.{name}": value for name, value in winding.items()},
        "model.alpha_RL": 1 / radius,
        "model.A_eq": A_eq,
        "model.B_eq": B_eq,
        "limit.i_max": torque / (1.5 * p * flux),
        "limit.u_max": u_max,
        "limit.v_max": v_max,
        "limit.a_max": n.get("control.a_max", 0.25 * spare_torque / A_eq),
    }
    observer = {"model.N_p": p, "model.Phi_PM": flux, "model.A_eq": A_eq, "model.B_eq": B_eq}
    if "control.k_1" in n:
        controller |= {"beta[1]": 2 * n["control.k_1"] / T_S, "beta[2]": 2 * n["control.k_2"] / T_S}
        pole = n["control.observer"] / T_S
        observer |= {"alpha_1": 3 * pole, "alpha_2": 3 * pole**2, "omega_d": pole / 3}
    return {"plant": plant, "controller": controller, "observer": observer}


def parameters(scenario: Scenario) -> dict[str, Any]:
    """All start values by full name."""
    return {f"{c.name}.{n}": x for c in scenario.system.components for n, x in c.parameters.items()}


USUAL = parameters(ec.load("prototype"))


@pytest.mark.parametrize("numbers", [MV43, MV43 | MORE], ids=["MV43", "with everything"])
def test_start_values_follow_from_entries(numbers: dict[str, tuple[float, str]]) -> None:
    """Each entry is changed by 5 %, or by 2 where it is a count; all parameters are held to closed forms."""
    affected: dict[str, set[str]] = {}
    before: dict[str, Any] = {}
    for entry in (None, *numbers):
        varied = dict(numbers)
        if entry is not None:
            number, unit = numbers[entry]
            varied[entry] = (number + 2 if isinstance(number, int) else 1.05 * number, unit)
        values = parameters(ec.load("prototype", actuator={"prototype": ec.Actuator(**sheet(varied))}))
        follows = expected({name: number for name, (number, _) in varied.items()})
        expected_values = USUAL | {
            f"prototype.{c}.{n}": x for c, x_of in follows.items() for n, x in x_of.items()
        }
        assert values.keys() == expected_values.keys(), entry
        for name, value in expected_values.items():
            assert values[name] == pytest.approx(value, rel=1e-12, abs=1e-300), (entry, name)
        if entry is None:
            before = values
        else:
            affected[entry] = {name.split(".")[1] for name in values if values[name] != before[name]}
    everywhere = ("motor.poles", "motor.kT", "motor.J_m", "screw.M_BS", "screw.lead", "gearbox.ratio")
    for entry in everywhere:
        assert affected[entry] == {"plant", "observer", "controller"}, entry
    # what only checks others, or is not what limits, moves nothing
    checks = {"motor.K_E", "motor.i_N", "inverter.i_max"} if numbers is MV43 else set()
    if numbers is not MV43:
        checks = {"motor.K_E", "motor.tau_N", "motor.i_max", "inverter.i_max", "motor.n_max"}
    assert {entry for entry, components in affected.items() if not components} == checks


def test_file_has_the_numbers_of_this_test() -> None:
    assert ec.Actuator.read(FILE).emla == ec.Actuator(**sheet(MV43)).emla


# ---- Conventions -------------------------------------------------------------------------------


def with_entries(**changes: Any) -> dict[str, Any]:
    """The sheet with entries changed, written table__key; None takes one out."""
    tables = copy.deepcopy({name: x for name, x in SHEET.items() if isinstance(x, dict)})
    for entry, value in changes.items():
        table, key = entry.split("__")
        tables.setdefault(table, {})[key] = value
        if value is None:
            del tables[table][key]
    return tables


@pytest.mark.parametrize(
    "changes",
    [
        {"motor__kT": f"{1.693717 / math.sqrt(2)!r} N m/A peak"},
        {"motor__kT": "1.693717 Nm/Arms"},
        {"motor__kT": "1.693717 N·m/A (rms)"},
        {"motor__kT": "1693.717 mN m/A_rms"},
        {"motor__kT": None, "motor__K_E": f"{1.693717 / 1.5 / math.sqrt(2)!r} V s/rad peak per phase"},
        {
            "motor__kT": None,
            "motor__K_E": f"{1.693717 / math.sqrt(3) * 100 * math.pi / 3!r} Vrms/kRPM line-to-line",
        },
        {
            "motor__kT": None,
            "motor__K_E": f"{1.693717 / math.sqrt(3) * 100 * math.pi / 3!r} V/1000 min^-1 rms, ph-ph",
        },
        {"motor__R": "1.16 Ω per phase"},
        {"motor__L": "5.75 mH phase"},
        {"motor__L": None, "motor__L_d": "11.5 mH line to line", "motor__L_q": "5.75 mH per phase"},
        {"motor__J_m": "9.60209e-4 kg·m²"},
        {"motor__J_m": "9.60209 kgcm^2"},
        {"motor__poles": None, "motor__N_p": 4},
        {"motor__n_max": "3500 1/min"},
        {"motor__n_max": f"{3500 * math.pi / 30!r} rad/s"},
        {"motor__i_max": f"{15 * math.sqrt(2)!r} A peak"},
        {"gearbox__efficiency": 0.95},
        {"screw__lead": "10 mm/rev"},
        {"inverter__U_supply": None, "inverter__U_DC": f"{460 * math.sqrt(2)!r} V"},
        {"inverter__U_supply": None, "inverter__u_max": f"{460 * math.sqrt(2 / 3)!r} V peak"},
        {"inverter__U_supply": f"{460 / math.sqrt(3)!r} Vrms per phase"},
        {"sensor__bits": None, "sensor__steps": 2**20},
        {"sensor__bits": None, "sensor__resolution": f"{2 / 2**20!r} mm"},
    ],
    ids=str,
)
def test_other_units_give_the_same_actuator(changes: dict[str, Any]) -> None:
    actuator, usual = ec.Actuator(**with_entries(**changes)), ec.Actuator.read(FILE)
    assert asdict(actuator.emla) == pytest.approx(asdict(usual.emla), rel=1e-14)
    assert actuator.plant == pytest.approx(usual.plant, rel=1e-14)


# ---- What is wrong with a sheet ----------------------------------------------------------------

WRONG = [
    ({"motor__kT": "1.7 N m/A"}, "motor.kT is ambiguous, rms or peak"),
    ({"motor__kT": "1.7 N m/A rms peak"}, "motor.kT is ambiguous, rms or peak"),
    ({"motor__R": "2.3 Ohm"}, "motor.R is ambiguous, line to line or per phase"),
    ({"motor__R": 2.3}, 'motor.R is 2.3 without a unit; add one, as in "2.3 Ohm line to line"'),
    ({"motor__J_m": "9.6"}, "motor.J_m is '9.6' without a unit"),
    ({"motor__J_m": "9.6 kg cm"}, "motor.J_m has the units kg cm and kg.m2"),
    ({"motor__J_m": "9.6 kg cm^2 rms"}, "motor.J_m must not be rms"),
    ({"motor__J_m": "-1 kg cm^2"}, "motor.J_m is -1 kg cm^2; it must be more than 0"),
    ({"motor__J_m": "nan kg cm^2"}, "motor.J_m is 'nan kg cm^2'; it must be a number"),
    ({"motor__J_m": "1e999 kg cm^2"}, "it must be a finite number"),
    ({"motor__J_m": True}, 'motor.J_m is True; write it as "9.6 kg cm^2"'),
    ({"motor__n_max": "58 Hz"}, "state whether it is in turns or radians"),
    ({"motor__poles": 7}, "motor.poles is 7; it must be even"),
    ({"motor__poles": "7"}, "motor.poles is 7; it must be even"),
    ({"motor__poles": 7.5}, "motor.poles is 7.5; it must be a whole number"),
    ({"motor__poles": 8, "motor__N_p": 4}, "[motor] has N_p and poles, which mean the same"),
    ({"motor__R": None}, "[motor] lacks R, the winding resistance"),
    ({"motor__L": None}, "[motor] needs L, or both L_d and L_q"),
    ({"motor__kT": None, "motor__K_E": None}, "[motor] lacks kT or K_E"),
    ({"motor__KT": "1.7 N m/A rms"}, "[motor] has the unknown entry 'KT'; did you mean 'kT'?"),
    ({"motor__colour": "red"}, "[motor] has the unknown entry 'colour'; use N_p, poles, kT"),
    ({"gearbox__ratio": math.nan}, "gearbox.ratio is nan; it must be a finite number"),
    ({"gearbox__efficiency": 95}, "gearbox.efficiency is 95; it must be at most 1"),
    ({"friction__F_C": "9 N", "friction__F_S": "8 N"}, "friction.F_S is less than friction.F_C"),
    ({"friction__F_C": "9 N", "friction__directional": 1}, "friction.directional is 1; it must be true or"),
    (
        {"motor__i_N": None, "thermal__tau_th": "1 s", "thermal__permitted_rise": "9 K"},
        "[thermal] needs motor",
    ),
    # what torque, current and voltage say of each other
    ({"motor__K_E": "108.258 V/krpm peak line to line"}, "a flux of 0.1996 Wb and motor.K_E one of 0.1492"),
    ({"motor__tau_max": "60 N m"}, "motor.i_max = 15 A rms (21.21 A peak) gives 25.41 N m"),
    ({"motor__tau_N": "12 N m"}, "that torque needs 7.085 A rms (10.02 A peak)"),
    ({"motor__i_N": "16 A rms"}, "motor.i_N is more than motor.i_max"),
    ({"gearbox__ratio": 1e300, "screw__lead": "1e-30 m"}, "too large or too small to compute with"),
    ({"inverter__U_supply": "300 V rms line to line"}, "enter a motor.n_max of at most 2929 rpm, or a"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG, ids=[str(changes) for changes, _ in WRONG])
def test_invalid_sheet_gives_one_message(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ec.CommandError) as caught:
        ec.Actuator(**with_entries(**changes))
    assert message in str(caught.value)


def test_all_problems_of_a_sheet_are_reported() -> None:
    changes = {"motor__R": None, "motor__kT": "1 N m/A", "screw__lead": "1 s", "sensor__bitz": 3}
    with pytest.raises(ec.CommandError) as caught:
        ec.Actuator(**with_entries(**changes))
    assert len(caught.value.fields["problems"]) == 4
    assert "for 4 reasons:" in str(caught.value)


def test_speed_in_the_message_is_possible() -> None:
    changes = {"inverter__U_supply": "300 V rms line to line", "motor__n_max": "2929 rpm"}
    assert ec.Actuator(**with_entries(**changes)).emla.v_max == pytest.approx(2929 / 60 * 2e-3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "[motor] lacks"),
        (b"motor = 3", "'motor' is 3; it must be a table, [motor]"),
        (b"[moter]\nR = 1", "it has the unknown entry 'moter'; did you mean 'motor'?"),
        (b"name = 3", "'name' is 3; it must be a text"),
        (b"[motor", "is not TOML"),
        (b"\xff\xfe", "is not a text in UTF-8"),
        (b"a = " + b"[" * 5000, "is not TOML"),
    ],
    ids=["empty", "no table", "other table", "no text", "no TOML", "no UTF-8", "deep"],
)
def test_invalid_actuator_files(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(ec.CommandError, match=r"the actuator '.*a\.toml'") as caught:
        ec.load("prototype", actuator={"prototype": tmp_path / "a.toml"})
    assert message in str(caught.value)


entry_keys = st.sampled_from([(table, e.key) for table, entries in TABLES.items() for e in entries])
odd = st.one_of(
    st.text(max_size=20),
    st.floats(),
    st.integers(),
    st.booleans(),
    st.lists(st.integers(), max_size=2),
    st.sampled_from(["1e308 kN", "1e-320 m", "0 A rms", "1 /", "5 rms", "1e5 km per phase", "[bold]1[/] N"]),
)


@given(st.lists(st.tuples(entry_keys, odd), min_size=1, max_size=3))
def test_any_entry_gives_an_actuator_or_a_message(changes: list[Any]) -> None:
    try:
        actuator = ec.Actuator(**with_entries(**{f"{table}__{key}": x for (table, key), x in changes}))
    except ec.CommandError as error:
        assert str(error)
    else:
        numbers = [x for x in asdict(actuator.emla).values() if isinstance(x, float)]
        assert all(map(math.isfinite, numbers)) and math.isfinite(actuator.emla.A_eq)


# ---- In its joint ------------------------------------------------------------------------------


def test_impossible_motions_are_refused() -> None:
    slow = ec.Actuator(**with_entries(screw__stroke="120 mm", screw__q_LB="50 mm", screw__v_max="30 mm/s"))
    with pytest.raises(ec.CommandError) as caught:
        ec.load("prototype", actuator={"prototype": slow})
    start, speed = caught.value.fields["problems"]
    assert start.startswith("prototype starts at 46 mm, outside the stroke of its actuator, 50 to 170 mm")
    assert "peaks at 46.87 mm/s, faster than its actuator's 30 mm/s" in speed and "1.57 times" in speed
    small_stroke = ec.Actuator(**with_entries(screw__stroke="120 mm"))
    with pytest.raises(ec.CommandError, match="goes from 50 to 150 mm, outside the stroke"):
        ec.load("prototype", actuator={"prototype": small_stroke})
    elsewhere = {f"prototype.reference.waypoint[{i}]": 0.1 for i in range(2, 10)}
    assert not ec.load("prototype", actuator={"prototype": small_stroke}, set=elsewhere).notes


def test_impossible_trajectories_are_refused() -> None:
    """That of tilt goes to 473 mm, as fast as the joint's own actuator may, 100 mm/s."""
    for changes, message in (
        ({"screw__stroke": "400 mm"}, "of tilt goes from 389 to 472.8 mm, outside the stroke"),
        ({"screw__stroke": "1 m", "screw__v_max": "80 mm/s"}, "of tilt peaks at .* use a --trajectory that"),
    ):
        with pytest.raises(ec.CommandError, match=message):
            ec.load("hdrm-replay", actuator={"tilt": ec.Actuator(**with_entries(**changes))})


def test_too_large_load_is_noted() -> None:
    level = "prototype.disturbance.load.level[*]"
    for load, message in (
        (30e3, "more than its continuous torque of 8.469 N m"),
        (90e3, "more than its peak torque of 25.41"),
    ):
        names = {level.replace("*", str(i)): load for i in range(1, 7)}
        (note,) = ec.load("prototype", actuator={"prototype": FILE}, set=names).notes
        assert message in note and f"{load * 2e-3 / (2 * math.pi) / 0.8075:.4g} N m" in note


def test_notes_on_fluxes_and_limits() -> None:
    changes = {"motor__K_E": "120 V/krpm rms line to line", "inverter__i_max": "10 A rms"}
    notes = ec.load("prototype", actuator={"prototype": ec.Actuator(**with_entries(**changes))}).notes
    assert [
        "0.1996 Wb and motor.K_E one of 0.2339 Wb, which differ by 17 %; the one of kT is used" in notes[0],
        "inverter.i_max leaves 16.94 N m of the motor's 25.41 N m" in notes[1],
    ] == [True, True]


def test_values_set_in_plant_and_models_are_not_noted() -> None:
    (note,) = ec.load("lift", set={"lift.plant.screw.M_BS": 99.0, "lift.observer.model.A_eq": 1.0}).notes
    assert note.startswith("lift.plant.screw.M_BS changes, but lift.controller.model.A_eq")
    assert "observer" not in note and "--actuator lift=FILE" in note
    plant_and_model = {"lift.plant.motor.R_s": 0.2, "lift.controller.model.R_s": 0.2}
    without_model = {"lift.plant.friction.F_C": 9.0, "lift.plant.start.x_L": 0.25}
    assert ec.load("lift", set=plant_and_model).notes == ec.load("lift", set=without_model).notes == ()


def test_gains_of_another_actuator_are_noted() -> None:
    for controller, gains, count in (("cac", "tuned", 1), ("foc", "rule", 0), ("rsba", "published", 1)):
        scenario = ec.load("prototype", actuator={"prototype": FILE}, controller=controller, gains=gains)
        assert len(scenario.notes) == count
        assert parameters(scenario)["prototype.controller.limit.a_max"] != 1.2


def test_every_system_accepts_actuators_for_its_joints() -> None:
    changes = {"screw__stroke": "1 m", "gearbox__ratio": 2}
    actuator = ec.Actuator(**with_entries(**changes))
    for name in ("study", "study-drive", "published", "hdrm-replay", "hdrm-coupled", "hdrm-merged", "tilt"):
        values, usual = parameters(ec.load(name, actuator={"tilt": actuator})), parameters(ec.load(name))
        tilt = {x for x in usual if values[x] != usual[x]}
        elsewhere = [x for x in tilt if not x.startswith("tilt.") and not x.endswith("[2]")]
        assert not elsewhere and any("observer.model" in x for x in tilt) and any("limit" in x for x in tilt)
    merged = parameters(ec.load("hdrm-merged", actuator={"tilt": actuator}))
    coupled = parameters(ec.load("hdrm-coupled", actuator={"tilt": actuator}))
    for machine in (merged, coupled):
        of = "machine.plant" if machine is merged else "machine.manipulator"
        assert machine[f"{of}.screw.M_BS[2]"] == 60.0 and machine[f"{of}.screw.q_UB[2]"] == 1.0
    assert merged["machine.plant.screw.M_BS[1]"] == 156.5


def test_unknown_joint_lists_the_joints(tmp_path: Path, fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match="no joint 'boom' for an actuator; use lift, tilt and tele"):
        ec.load("study", actuator={"boom": FILE})
    with pytest.raises(ec.CommandError, match="run hdrm-coupled"):
        ec.load("hdrm-merged", actuator={"tilt": ec.Actuator(**with_entries(friction__F_C="9 N"))})
    package = ec.load("prototype", fmus=fmu_folder).export(tmp_path / "p.ssp")
    with pytest.raises(ec.CommandError, match="has its own actuators; --actuator is for built-in"):
        ec.load(package, actuator={"prototype": FILE})


# ---- Run ---------------------------------------------------------------------------------------


def test_actuator_in_a_scenario_file_runs(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_bytes(FILE.read_bytes())
    (tmp_path / "run.toml").write_text('system = "prototype"\n[actuator]\nprototype = "my.toml"\n')
    scenario = ec.load(tmp_path / "run.toml", fmus=fmu_folder)
    assert tmp_path / "my.toml" in scenario.options.files_read()
    result = run_scenario(scenario, tmp_path / "out")
    figures = result.metrics["joints"]["prototype"]
    assert figures["held"] and figures["trip"] is None
    assert 0.0 < figures["position_error_m"] < 2e-5
    # 20 kN at 2 mm a turn of the motor with 0.8075, and what viscous friction adds
    assert figures["torque_effort_N_m"] == pytest.approx(20e3 * 2e-3 / (2 * math.pi) / 0.8075, rel=0.02)
    settings = result.record["settings"]["actuator"]["prototype"]
    assert settings["file"].endswith("my.toml") and len(settings["sha256"]) == 64
    assert "motor.R 2.32 Ohm line to line -> plant motor.R_s = 1.16 Ohm" in settings["conversion"]
    assert settings["entered"]["motor.kT"] == "1.693717 N m/A rms"
    in_python = ec.load("prototype", actuator={"prototype": ec.Actuator.read(FILE)}, fmus=fmu_folder)
    with in_python.prepare() as simulation:
        assert (simulation.run()["prototype.plant.x_L"] == result["prototype.plant.x_L"]).all()
        with pytest.raises(ec.CommandError, match="actuator"):
            simulation.run(actuator={"prototype": FILE})
    for name, value in {"actuator": {"prototype": FILE}, "controller": "foc"}.items():
        with pytest.raises(ec.CommandError, match=f"exists already; set {name} when"):
            in_python.prepare(**{name: value})


def test_actuator_with_measured_load_and_reference(emla: Emla, tmp_path: Path) -> None:
    """All three as files; the actuator's stroke has no room for the reference of the scenario."""
    text = FILE.read_text(encoding="utf-8").replace('stroke = "400 mm"', 'q_LB = "190 mm"\nstroke = "90 mm"')
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    times = np.linspace(0.0, 2.0, 201)
    position, force = 240.0 - 30.0 * np.cos(np.pi * times), 9.0 + 3.0 * np.sin(np.pi * times)
    for name, header, values in (("ref", "Position [mm]", position), ("load", "Force [kN]", force)):
        rows = [f"{t!r},{x!r}" for t, x in zip(times.tolist(), values.tolist(), strict=True)]
        (tmp_path / f"{name}.csv").write_text("\n".join([f"time,{header}", *rows]), encoding="utf-8")
    columns = ("x_d=Position", "v_d=der(Position)", "a_d=der(der(Position))")
    reference = ",".join(f"prototype.reference.{column}" for column in columns)
    result = emla(
        *("run", "prototype", "--actuator", "prototype=my.toml", "--output", "out", "--no-plots"),
        *("--input", "load.csv:prototype.disturbance.F_L=Force"),
        *("--input", f"ref.csv:{reference},interpolation=cubic"),
        *("--set", "prototype.plant.start.x_L=0.206", "--set", "prototype.observer.start.x_hat=0.206"),
        *("--stop-time", "2"),
    )
    assert result.exit_code == 0, result.output
    figures = json.loads((tmp_path / "out/metrics.json").read_text(encoding="utf-8"))["joints"]["prototype"]
    assert figures["held"] and figures["trip"] is None
    assert 0.0 < figures["position_error_m"] < 1e-4
    most = 12e3 * 2e-3 / (2 * math.pi) / 0.8075
    assert figures["torque_effort_N_m"] == pytest.approx(most, rel=0.1)


def test_workers_need_no_actuator_file(fmu_folder: Path) -> None:
    preparation = Preparation.of(ec.load("prototype", actuator={"prototype": FILE}, fmus=fmu_folder))
    assert not preparation.options.actuator
    assert preparation.system.component("prototype.plant").parameters["screw.M_BS"] == 60.0
    assert preparation.identity["values set"]["prototype.controller.model.A_eq"] == str(
        ec.Actuator.read(FILE).emla.A_eq
    )
    assert format_arguments({"actuator": {"prototype": FILE}}) == ["--actuator", f"prototype={FILE}"]
    read: dict[str, Any] = {"prototype": ec.Actuator.read(FILE)}
    assert format_arguments({"actuator": read}) == ["--actuator", f"prototype={FILE}"]
    assert format_arguments({"actuator": {"prototype": ec.Actuator(**sheet(MV43))}}) is None
    assert to_plain(read)["prototype"]["sha256"] is not None


def test_page_shows_the_file_and_every_entry() -> None:
    page = (ROOT / "docs/actuator.md").read_text(encoding="utf-8")
    assert FILE.read_text(encoding="utf-8").strip() in page
    for table, entries in TABLES.items():
        for entry in entries:
            assert f"| `{table}.{entry.key}` |" in page

"""Conversions from data-sheet entries to model parameters."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from emla_fmu import EmlaPlant, motion_law

from . import derived
from .entries import TABLES, SheetValue

_FMI_NAMES = {x.attribute: str(x.name) for x in EmlaPlant.layout().parameters}
_PLANT = {entry: _FMI_NAMES[attribute] for entry, attribute in derived.PLANT_ATTRIBUTES.items()} | {
    "motor.R": "motor.R_s",
    "motor.L": "motor.L_d and motor.L_q",
    "friction.directional": "gearbox.directional",
    **{
        f"{table}.{key}": f"{table}.{key}"
        for table, keys in {
            "motor": ("L_d", "L_q", "J_m", "B_m"),
            "coupling": ("J_c",),
            "gearbox": ("J_GB",),
            "screw": ("lead", "M_BS", "B_BS", "q_LB"),
            "sensor": ("resolution",),
        }.items()
        for key in keys
    },
}
"""Entries that each become one parameter of the plant."""

_SPRINGS = ("compliance.bearing", "compliance.screw", "compliance.nut")
_INERTIA = ("motor.J_m", "coupling.J_c", "gearbox.J_GB", "screw.J_BS", "screw.M_BS")
_FRICTION = ("motor.B_m", "screw.B_BS")
_GEAR = ("gearbox.ratio", "screw.lead")


_PRINTED = (
    *(f"plant motor.{name}" for name in ("R_s", "L_d and motor.L_q", "L_d", "L_q", "Phi_PM")),
    *("plant inverter.u_max", "controller limit.i_max", "plant screw.v_max", "known A_eq"),
)
"""Parameters that are printed before a run: their data-sheet values are ambiguous, or much follows from them.
"""


@dataclass(frozen=True)
class Conversion:
    """Entries, as "table.key text", and the parameter that follows from them."""

    entered: tuple[str, ...]
    parameter: str
    value: float
    unit: str

    @property
    def is_shown_before_run(self) -> bool:
        """Whether it is printed before a run."""
        return self.parameter in _PRINTED

    def __str__(self) -> str:
        return f"{', '.join(self.entered)} -> {self.parameter} = {self.value:.6g} {self.unit}".rstrip()


def list_conversions(entered: Mapping[str, SheetValue]) -> Iterator[Conversion]:
    """Yield all parameters that follow from the entries."""
    units = {f"{table}.{e.key}": e.unit for table, entries in TABLES.items() for e in entries}
    for name, entry in entered.items():
        if name in _PLANT and (name != "coupling.J_c" or "screw.J_BS" not in entered):
            text = f"{name} {entry.text}"
            yield Conversion((text,), f"plant {_PLANT[name]}", entry.number, units[name])
    yield from _convert_combined(entered)


def _convert_combined(entered: Mapping[str, SheetValue]) -> Iterator[Conversion]:
    """Yield parameters that follow from several entries."""
    v = {name: entry.number for name, entry in entered.items()}
    emla = derived.emla(v)

    def convert(parameter: str, value: float, unit: str, *names: str) -> Conversion:
        texts = tuple(f"{name} {entered[name].text}" for name in names if name in entered)
        return Conversion(texts, parameter, value, unit)

    poles, constant = ("motor.N_p", "motor.poles"), "motor.kT" if "motor.kT" in v else "motor.K_E"
    flux = (constant, *poles)
    yield convert("plant motor.N_p", emla.N_p, "", *poles)
    yield convert("plant motor.Phi_PM", emla.Phi_PM, "Wb", *flux)
    if "gearbox.ratio" in v:
        yield convert("plant gearbox.rho", emla.rho, "", "gearbox.ratio")
    yield convert("plant gearbox.eta_GB", emla.eta_GB, "", "gearbox.efficiency", "screw.efficiency")
    if "screw.J_BS" in v:
        yield convert("plant coupling.J_c", emla.J_c, "kg.m2", "coupling.J_c", "screw.J_BS", "gearbox.ratio")
    yield convert("plant screw.q_UB", emla.q_UB, "m", "screw.stroke", "screw.q_LB")
    yield convert("plant screw.v_max", emla.v_max, "m/s", "motor.n_max", "screw.v_max", *_GEAR)
    yield convert(
        "plant inverter.u_max", emla.u_max, "V", "inverter.U_DC", "inverter.U_supply", "inverter.u_max"
    )
    if "sensor.resolution" not in v:
        yield convert(
            "plant sensor.resolution", derived.resolution(v), "m", "sensor.bits", "sensor.steps", *_GEAR
        )
    if "thermal.tau_th" in v:
        yield convert("plant motor.i_N", v["motor.i_N"], "A", "motor.i_N")
    if any(name in v for name in _SPRINGS):
        bearing, screw, nut = (v.get(name, math.inf) for name in _SPRINGS)
        stiffness = motion_law.k_L(bearing, screw, nut, math.inf)
        yield convert("stiffness without the structure", stiffness, "N/m", *_SPRINGS)
    if "compliance.backlash" in v:
        yield convert("plant transmission.backlash", v["compliance.backlash"], "m", "compliance.backlash")
    limits = tuple(name for name, _ in derived.torques(v))
    yield convert("controller limit.i_max", emla.i_max, "A", *limits, *flux)
    yield convert("known alpha_RL", emla.alpha_RL, "rad/m", *_GEAR)
    yield convert("known A_eq", emla.A_eq, "kg.m", *_INERTIA, *_GEAR)
    yield convert("known B_eq", emla.B_eq, "kg.m/s", *_FRICTION, *_GEAR)

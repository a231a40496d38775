"""Conversions from data-sheet entries to model parameters."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from emla_fmu import EmlaPlant, motion_law

from . import derived
from .entries import TABLES
from .sheet_values import SheetValue

_FMI_NAMES = {x.attribute: str(x.name) for x in EmlaPlant.layout().parameters}
_PLANT = {entry: _FMI_NAMES[attribute] for entry, attribute in derived.PLANT.items()} | {
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


_SHORT = (
    *(f"plant motor.{name}" for name in ("R_s", "L_d and motor.L_q", "L_d", "L_q", "Phi_PM")),
    *("plant inverter.u_max", "controller limit.i_max", "plant screw.v_max", "known A_eq"),
)
"""Parameters that are printed before a run: their data-sheet values are ambiguous, or much follows from them.
"""


@dataclass(frozen=True)
class Conversion:
    """Entries, as "table.key text", and the parameter that follows from them."""

    entered: tuple[str, ...]
    becomes: str
    value: float
    unit: str

    @property
    def is_short(self) -> bool:
        """Whether it is printed before a run."""
        return self.becomes in _SHORT

    def __str__(self) -> str:
        return f"{', '.join(self.entered)} -> {self.becomes} = {self.value:.6g} {self.unit}".rstrip()


def list_conversions(entered: Mapping[str, SheetValue]) -> Iterator[Conversion]:
    """Yield all parameters that follow from the entries."""
    units = {f"{table}.{e.key}": e.unit for table, entries in TABLES.items() for e in entries}
    for place, found in entered.items():
        if place in _PLANT and (place != "coupling.J_c" or "screw.J_BS" not in entered):
            text = f"{place} {found.text}"
            yield Conversion((text,), f"plant {_PLANT[place]}", found.number, units[place])
    yield from _convert_combined(entered)


def _convert_combined(entered: Mapping[str, SheetValue]) -> Iterator[Conversion]:
    """Yield parameters that follow from several entries."""
    v = {place: found.number for place, found in entered.items()}
    made = derived.emla(v)

    def of(becomes: str, value: float, unit: str, *places: str) -> Conversion:
        texts = tuple(f"{place} {entered[place].text}" for place in places if place in entered)
        return Conversion(texts, becomes, value, unit)

    poles, constant = ("motor.N_p", "motor.poles"), "motor.kT" if "motor.kT" in v else "motor.K_E"
    flux = (constant, *poles)
    yield of("plant motor.N_p", made.N_p, "", *poles)
    yield of("plant motor.Phi_PM", made.Phi_PM, "Wb", *flux)
    if "gearbox.ratio" in v:
        yield of("plant gearbox.rho", made.rho, "", "gearbox.ratio")
    yield of("plant gearbox.eta_GB", made.eta_GB, "", "gearbox.efficiency", "screw.efficiency")
    if "screw.J_BS" in v:
        yield of("plant coupling.J_c", made.J_c, "kg.m2", "coupling.J_c", "screw.J_BS", "gearbox.ratio")
    yield of("plant screw.q_UB", made.q_UB, "m", "screw.stroke", "screw.q_LB")
    yield of("plant screw.v_max", made.v_max, "m/s", "motor.n_max", "screw.v_max", *_GEAR)
    yield of("plant inverter.u_max", made.u_max, "V", "inverter.U_DC", "inverter.U_supply", "inverter.u_max")
    if "sensor.resolution" not in v:
        yield of("plant sensor.resolution", derived.resolution(v), "m", "sensor.bits", "sensor.steps", *_GEAR)
    if "thermal.tau_th" in v:
        yield of("plant motor.i_N", v["motor.i_N"], "A", "motor.i_N")
    if any(place in v for place in _SPRINGS):
        bearing, screw, nut = (v.get(place, math.inf) for place in _SPRINGS)
        stiffness = motion_law.k_L(bearing, screw, nut, math.inf)
        yield of("stiffness without the structure", stiffness, "N/m", *_SPRINGS)
    if "compliance.backlash" in v:
        yield of("plant transmission.backlash", v["compliance.backlash"], "m", "compliance.backlash")
    limits = tuple(place for place, _ in derived.torques(v))
    yield of("controller limit.i_max", made.i_max, "A", *limits, *flux)
    yield of("known alpha_RL", made.alpha_RL, "rad/m", *_GEAR)
    yield of("known A_eq", made.A_eq, "kg.m", *_INERTIA, *_GEAR)
    yield of("known B_eq", made.B_eq, "kg.m/s", *_FRICTION, *_GEAR)

"""A system that knows nothing of joints: a slide on a spring drive, which follows a motion, as an SSP."""

from pathlib import Path
from typing import Any

import emla_cosim as ec
import fmublock
from fmublock import Block, Input, Output, Parameter, State


class Slide(Block):
    """A mass that a spring and a damper pull to where it should be."""

    command = Input(unit="m", description="Where it should be")
    m = Parameter(2.0, unit="kg", description="Mass")
    k = Parameter(5000.0, unit="N/m", description="Stiffness")
    d = Parameter(200.0, unit="N.s/m", description="Damping")
    reach = Parameter(0.08, unit="m", description="Largest position")
    place = State(0.01, unit="m", description="Position")
    rate = State(0.0, unit="m/s", description="Speed")
    pull = Output(unit="N", description="Force of spring and damper")

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"place": v.rate, "rate": (v.k * (v.command - v.place) - v.d * v.rate) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"pull": v.k * (v.command - v.place) - v.d * v.rate}


def axis(folder: Path, fmus: Path) -> Path:
    """The package of the system, made in this folder; it takes 0.8 s in steps of 1 ms."""
    fmublock.build(Slide, folder / "Slide.fmu")
    system = ec.System.of(
        {"gantry.motion": "Reference", "gantry.slide": str(folder / "Slide.fmu")},
        ["gantry.motion.x_d -> gantry.slide.command"],
        set={"gantry.motion.waypoint[2]": 0.1, "gantry.motion.move.duration[1]": 0.3},
    )
    scenario = ec.load(system, stop_time=0.8, step_size=1e-3, fmus=fmus)
    return scenario.export(folder / "axis.ssp")

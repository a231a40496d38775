"""Names that parameters of the paper's manipulator have in problem files of trajectories."""

from collections.abc import Mapping

FORMER_NAMES: Mapping[str, str] = {
    **{
        f"{joint}_{name}": f"{joint}.{name}"
        for joint in ("lift", "tilt")
        for name in ("a", "b", "L_0", "delta", "epsilon")
    },
    "lift_length": "lift_boom.length",
    **{
        f"{boom}_{name}": f"{boom}_boom.{name}"
        for boom in ("lift", "outer", "inner")
        for name in ("m", "c", "J")
    },
    "reach": "inner_boom.reach",
    "payload_J": "payload.J",
    "M_BS": "screw.M_BS",
    "tube_share": "tube.share",
    "motor_m": "motor.m",
    "housing_c": "housing.c",
    "housing_J": "housing.J",
    "tube_c": "tube.c",
    "tube_J": "tube.J",
    "q_LB": "screw.q_LB",
    "q_UB": "screw.q_UB",
    "gravity": "gravity",
}
"""FMI names by these names."""

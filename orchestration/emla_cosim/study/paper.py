"""What the paper prints of its comparison: Tables VI and VIII, cell by cell, and their averages."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .systems import STUDY


class Cells(NamedTuple):
    """Position error in m, speed error in m/s, torque effort in N m and convergence time in s.

    As normalised averages they are ratios. The names are those of `JointFigures`.
    """

    position_error_m: float
    velocity_error_m_s: float
    torque_effort_N_m: float
    convergence_time_s: float


@dataclass(frozen=True)
class PrintedTable:
    """A table of the paper: cells by scenario and joint, and by controller; averages by controller.

    `references` says in words what our scenarios follow in the place of references that are not printed.
    """

    name: str
    cells: Mapping[tuple[str, str], Mapping[str, Cells]]
    averages: Mapping[str, Cells]
    references: str

    @property
    def scenarios(self) -> list[str]:
        """Our scenarios that stand for the rows."""
        return list(dict.fromkeys(scenario for scenario, _ in self.cells))

    def recomputed(self, controller: str) -> Cells:
        """The normalised average of the printed cells: the ratio of the means, which gives most of them."""
        both = zip(self._sums(controller), self._sums(REFERENCE), strict=True)
        return Cells(*(ours / base for ours, base in both))

    def _sums(self, controller: str) -> list[float]:
        return [sum(column) for column in zip(*(row[controller] for row in self.cells.values()), strict=True)]


REFERENCE = "rsba"
"""The controller that averages are relative to."""


def _moves() -> str:
    return "; ".join(
        f"{name} {s.q_S:g} to {s.q_E:g} m, at most {s.v_peak:g} m/s, against {s.load / 1e3:g} kN"
        for name, s in STUDY.items()
    )


TABLE_VI = PrintedTable(
    "Table VI",
    {
        ("study", "lift"): {
            "rsba": Cells(6e-5, 3.8e-4, 93.75, 0.083),
            "cac": Cells(9e-5, 4.2e-4, 104.22, 0.091),
            "anatc": Cells(7e-5, 4.9e-4, 112.53, 0.095),
        },
        ("study", "tilt"): {
            "rsba": Cells(6.5e-5, 2.08e-3, 102.0, 0.085),
            "cac": Cells(1.12e-4, 2.21e-3, 111.0, 0.094),
            "anatc": Cells(6.4e-5, 2.30e-3, 120.0, 0.095),
        },
        ("study", "telescope"): {
            "rsba": Cells(2.13e-3, 4.7e-3, 35.0, 0.086),
            "cac": Cells(2.14e-3, 4.9e-3, 41.0, 0.095),
            "anatc": Cells(2.15e-3, 4.8e-3, 51.0, 0.098),
        },
    },
    {
        "rsba": Cells(1.0, 1.0, 1.0, 1.0),
        "cac": Cells(1.040, 1.090, 1.110, 1.100),
        "anatc": Cells(1.010, 1.100, 1.230, 1.130),
    },
    "The paper does not print the references behind its Table VI. Ours are quintic moves from rest to rest, "
    f"then at rest to 10 s ({_moves()}), with the disturbances (82) to (84), controller and observer every "
    "0.1 ms, the position through the observer from an encoder of 20 bits per motor turn, ideal current "
    "sensors, and no computing delay.",
)

TABLE_VIII = PrintedTable(
    "Table VIII",
    {
        ("experiment-1", "prototype"): {
            "rsba": Cells(8e-4, 2e-3, 35.0, 0.12),
            "cac": Cells(4e-3, 4e-3, 39.5, 0.22),
            "anatc": Cells(2.7e-3, 6e-3, 40.0, 0.28),
        },
        ("experiment-2", "prototype"): {
            "rsba": Cells(8e-4, 2.5e-3, 35.0, 0.14),
            "cac": Cells(4e-3, 3.7e-3, 39.5, 0.25),
            "anatc": Cells(2.5e-3, 3.2e-3, 40.0, 0.32),
        },
    },
    {
        "rsba": Cells(1.0, 1.0, 1.0, 1.0),
        "cac": Cells(5.0, 1.71, 1.13, 1.81),
        "anatc": Cells(3.25, 2.04, 1.14, 2.31),
    },
    "The paper measured its Table VIII on a test bench; ours is simulated. The moves are quintic between "
    "way-points read off the figures (0.05 to 0.30 m, two stops out, three back, 40 s a cycle, at most 0.026 "
    "and 0.030 m/s), the load 7 to 70 kN in five levels and 70 kN with a ripple of 5 kN, for 320 s; controller "
    "and observer run every 1 ms beside a plant at 0.1 ms, with one sample of computing delay, an encoder, and "
    "noise of position and current.",
)

PRINTED = (TABLE_VI, TABLE_VIII)
"""The tables of the paper that can be compared."""

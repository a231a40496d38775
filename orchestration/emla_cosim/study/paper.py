"""The paper's comparison: the cells of Tables VI and VIII, and their averages."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .joints.joint_table import Cells
from .joints.schema import load_joint
from .systems import EXPERIMENTS, STUDY


@dataclass(frozen=True)
class PrintedTable:
    """A table of the paper: cells by scenario and joint, and by controller; averages by controller.

    `references` describes the references of our scenarios, since the paper does not print them.
    """

    name: str
    cells: Mapping[tuple[str, str], Mapping[str, Cells]]
    averages: Mapping[str, Cells]
    references: str

    @property
    def scenarios(self) -> list[str]:
        """Our scenarios that reproduce the rows."""
        return list(dict.fromkeys(scenario for scenario, _ in self.cells))

    def recomputed(self, controller: str) -> Cells:
        """Return normalised averages of the printed cells: ratios of means, which reproduce most of them."""
        sums = zip(self._compute_sums(controller), self._compute_sums(REFERENCE), strict=True)
        # ratios of means, not means of ratios, reproduce most of the printed averages
        return Cells(*(own_sum / base for own_sum, base in sums))

    def _compute_sums(self, controller: str) -> list[float]:
        """Return the sum of each figure over all rows, in the order of `Cells`."""
        return [sum(column) for column in zip(*(row[controller] for row in self.cells.values()), strict=True)]


REFERENCE = "rsba"
"""The controller to which averages are relative."""


def _describe_moves() -> str:
    """Return the moves of the study's joints, with peak speeds and loads, as a text."""
    return "; ".join(
        f"{name} {s.reference.q_S:g} to {s.reference.q_E:g} m, at most {s.reference.peak:g} m/s, "
        f"against {s.load.largest / 1e3:g} kN"
        for name, s in ((name, load_joint(name)) for name in STUDY)
    )


def _read_cells(rows: Iterable[tuple[str, str]]) -> dict[tuple[str, str], Mapping[str, Cells]]:
    """Return the printed cells, from the files of the joints, by scenario and joint."""
    return {(scenario, joint): load_joint(joint).printed_in(scenario) for scenario, joint in rows}


TABLE_VI = PrintedTable(
    "Table VI",
    _read_cells(("study", joint) for joint in STUDY),
    {
        "rsba": Cells(1.0, 1.0, 1.0, 1.0),
        "cac": Cells(1.040, 1.090, 1.110, 1.100),
        "anatc": Cells(1.010, 1.100, 1.230, 1.130),
    },
    f"The paper does not print the references of its Table VI. Ours are quintic moves from rest to rest "
    f"({_describe_moves()}), then rest up to 10 s, with the disturbances (82) to (84). Controller and "
    "observer run every 0.1 ms. The observer gets the position from an encoder of 20 bits per motor turn. "
    "Current sensors are ideal, and there is no computing delay.",
)

TABLE_VIII = PrintedTable(
    "Table VIII",
    _read_cells(EXPERIMENTS.items()),
    {
        "rsba": Cells(1.0, 1.0, 1.0, 1.0),
        "cac": Cells(5.0, 1.71, 1.13, 1.81),
        "anatc": Cells(3.25, 2.04, 1.14, 2.31),
    },
    "The paper measured its Table VIII on a test bench; ours is simulated. The moves are quintic between "
    "way-points read from the figures: 0.05 to 0.30 m, two stops out, three back, 40 s a cycle, at most "
    "0.026 and 0.030 m/s. The load is 7 to 70 kN in five levels, or 70 kN throughout, with a ripple of "
    "5 kN, for 320 s. Controller and observer run every 1 ms beside a plant at 0.1 ms. They have one sample "
    "of computing delay, an encoder, and noise of position and current.",
)

PRINTED = (TABLE_VI, TABLE_VIII)
"""The tables of the paper that can be compared."""

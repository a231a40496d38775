"""Load forces along the stroke, as joint files have them: lists of positions and forces, or a CSV file."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from emla_fmu import EmlaAxis, stroke_load

from ...base.errors import CommandError
from ...base.quantities import Quantity, parse_unit_name
from ...base.table_entries import Location

_COLUMNS = (("position", "m"), ("force", "N"))
"""Columns of a file, with the units of numbers without a unit."""


class StrokeTable(NamedTuple):
    """A load force along the stroke: forces in N at positions in m, which increase."""

    position: tuple[float, ...]
    force: tuple[float, ...]
    interpolation: int = stroke_load.LINEAR

    def force_at(self, x: float) -> float:
        """Return the force in N at a position of the load in m."""
        return stroke_load.force_at(x, *self._fill(), self.interpolation)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the plant, by attribute."""
        position, force = self._fill()
        return {"position": position, "force": force, "interpolation": self.interpolation}

    def check(self) -> "StrokeTable":
        """Return the table; raise ValueError if its points cannot be used."""
        count = len(self.position)
        if count != len(self.force):
            raise ValueError(
                f"has {count} values of position and {len(self.force)} of force; they must agree."
            )
        if not 2 <= count <= stroke_load.POINTS:
            raise ValueError(
                f"has {count} points of force over position; it must have 2 to {stroke_load.POINTS}."
            )
        for a, b in pairwise(self.position):
            if not a < b:
                raise ValueError(f"has the position {b:g} m after {a:g} m; positions must increase.")
        return self

    def _fill(self) -> tuple[list[float], list[float]]:
        missing = stroke_load.POINTS - len(self.position)
        return [*self.position, *[self.position[-1]] * missing], [*self.force, *[self.force[-1]] * missing]


def read_plant_table(value: Callable[[str], float | None]) -> StrokeTable | None:
    """Return the load along the stroke of a plant; None if it has none, or an unknown value.

    Args:
        value: Returns the plant's parameter of an FMI name; None if it is unknown.
    """
    names = {x.attribute: [s.name for s in x.scalars()] for x in EmlaAxis.layout().parameters}
    position, force, (kind,) = (
        [value(name) for name in names[attribute]] for attribute in ("position", "force", "interpolation")
    )
    if kind is None or None in position or None in force or not any(force):
        return None
    return StrokeTable(tuple(map(float, position)), tuple(map(float, force)), int(kind))  # type: ignore[arg-type]


def read_stroke_file(value: Any, at: Location, folder: Path | None) -> StrokeTable:
    """Read positions and forces from the two columns of a table file that an entry names.

    Raises:
        CommandError: The file cannot be read, or is not such a table.
    """
    from ...inputs.table_files import read_table  # slow to import

    if not isinstance(value, str):
        raise CommandError(f"{at.label} is {value!r}; it must be the path of a CSV file.")
    data = read_table((folder or Path()) / value, "the load table")
    if len(data.headers) != len(_COLUMNS):
        raise CommandError(
            f"{data.label} has {len(data.headers)} columns; it must have two: positions and forces, with "
            "headers such as 'position [mm]' and 'force [kN]'."
        )
    columns = list[tuple[float, ...]]()
    for index, (subject, unit) in enumerate(_COLUMNS):
        header, target = data.headers[index], parse_unit_name(unit, "")
        label = f"the column '{header.text}' of {data.label}"
        header.check_unit_like_end(target, label, f"the {subject}", header.text)
        column_unit = None if header.unit is None else parse_unit_name(header.unit, label, target)
        numbers: Sequence[float] = data.numbers(index, padded=True).tolist()
        columns.append(tuple(Quantity(x, column_unit).in_unit(target, label) for x in numbers))
    try:
        return StrokeTable(columns[0], columns[1]).check()
    except ValueError as error:
        raise CommandError(f"{data.label} {error}") from error

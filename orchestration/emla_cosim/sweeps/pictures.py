"""The pictures of a sweep by name, and as files."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ..base.errors import CommandError, check_choice
from .data import SweepData
from .drawing.bands import draw_bands
from .drawing.bar_charts import draw_sobol, draw_tornado
from .drawing.scatter import draw_figures
from .drawing.stability import draw_map
from .sensitivity import ONE_AT_A_TIME

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES: dict[str, "Callable[[SweepData, Sequence[str]], Figure]"] = {
    "bands": draw_bands,
    "figures": draw_figures,
    "tornado": draw_tornado,
    "sobol": draw_sobol,
    "map": draw_map,
}
"""What draws each of the pictures that `SweepResult.plot` explains, for a result and the names to show.

They raise CommandError where a result has nothing for them.
"""


_ONE_AT_A_TIME = ("bands", "tornado")


def draw_picture(result: SweepData, kind: str, names: Sequence[str] = ()) -> "Figure":
    """One picture; CommandError where there is no such kind, name, or nothing to draw."""
    check_choice("picture", kind, PICTURES)
    return PICTURES[kind](result, names)


def draw_pictures(result: SweepData) -> "Iterator[tuple[str, Figure]]":
    """Draw each picture that makes sense for a result, with the name of its file.

    Of factors that vary one at a time a tornado says all that there is.
    """
    for kind in _ONE_AT_A_TIME if result.sampling == ONE_AT_A_TIME else PICTURES:
        try:
            figure = draw_picture(result, kind)
        except CommandError:  # the result has nothing for it
            continue
        yield f"{kind}.png", figure

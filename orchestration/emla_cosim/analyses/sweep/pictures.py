"""Draw the pictures of a sweep by name."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ...base.errors import CommandError, check_choice
from ..variants.data import SweepData
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
"""Functions that draw the pictures of `SweepResult.plot`, from a result and the names to show.

They raise CommandError if the result has no data for the picture.
"""


_ONE_AT_A_TIME = ("bands", "tornado")


def draw_picture(result: SweepData, kind: str, names: Sequence[str] = ()) -> "Figure":
    """Draw one picture. Raise CommandError for an unknown kind or name, or if there is nothing to draw."""
    check_choice("picture", kind, PICTURES)
    return PICTURES[kind](result, names)


def draw_pictures(result: SweepData) -> "Iterator[tuple[str, Figure]]":
    """Yield each picture that suits a result, with its file name.

    For one-at-a-time sampling, a tornado shows all figures.
    """
    for kind in _ONE_AT_A_TIME if result.sampling == ONE_AT_A_TIME else PICTURES:
        try:
            figure = draw_picture(result, kind)
        except CommandError:  # the result has nothing for it
            continue
        yield f"{kind}.png", figure

"""Animations of results: those that are registered for what a run has, as GIF."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..base.errors import CommandError, RunError, join_names
from ..base.files import write_atomically
from ..base.progress import Progress
from ..sandbox.interruption import catch_interrupts

if TYPE_CHECKING:
    from PIL import Image

    from ..run.result import Result

Pixels = npt.NDArray[np.uint8]
"""A frame: rows, columns, and red, green and blue."""

_LAST = 1500
"""How long the last frame is seen before the first one comes again, ms."""

_COLOR_DISTANCE = 8
"""Colours that differ by less, of 255, are one where Pillow looks for the nearest."""


class Film(ABC):
    """The frames of an animation, each drawn when it is asked for; all have one size.

    `period` is how long each is seen, in s. The colours of the last one are those of all.
    """

    period: float

    @abstractmethod
    def __len__(self) -> int:
        """How many frames there are."""

    @abstractmethod
    def __getitem__(self, index: int) -> Pixels:
        """The frame at this position, from 0."""


class Animation(ABC):
    """What makes a film of a run, whatever it shows; `takes` says in words which runs it is for."""

    takes: str

    @abstractmethod
    def signals(self, names: Collection[str]) -> Sequence[str] | None:
        """Those of these signals that it needs; None where they are not enough."""

    @abstractmethod
    def film(self, result: "Result") -> Film:
        """The film of a run that kept these signals. Raises RunError where there is nothing to see."""


ANIMATIONS: dict[str, Animation] = {}
"""Animations that are drawn, where one is wanted, of a run that has signals for them, by file name."""


def check_animated(name: str, all_names: Collection[str], kept: Collection[str]) -> None:
    """Raise CommandError unless the signals that are kept of the run of this name can be animated."""
    needed = [names for a in ANIMATIONS.values() if (names := a.signals(all_names)) is not None]
    if not needed:
        takes = join_names(a.takes for a in ANIMATIONS.values())
        raise CommandError(f"'{name}' has nothing to animate: that takes {takes}.", name=name)
    missing = [[n for n in names if n not in kept] for names in needed]
    if all(missing):
        raise CommandError(
            f"an animation needs signals that are not kept: {join_names(missing[0])}.", missing=missing[0]
        )


def animate(result: "Result", folder: Path, progress: Progress) -> list[Path]:
    """Draw all animations that the result has signals for; returns the files written.

    Raises OSError, and RunError where Ctrl-C ends it: there is no file then.
    """
    written = []
    for name, animation in ANIMATIONS.items():
        if animation.signals(result.names) is not None:
            film = animation.film(result)
            progress.begin("animating", len(film))
            path = folder / f"{name}.gif"
            with write_atomically(path) as stream:
                write_gif(film, stream, progress)
            written.append(path)
    return written


def write_gif(film: Film, stream: IO[bytes], progress: Progress) -> None:
    """Write a film that is shown again and again. Raises RunError where Ctrl-C ends it."""
    from PIL import Image

    def image(index: int) -> "Image.Image":
        if asked():
            raise RunError("the animation was interrupted.")
        progress.advance(1)
        return Image.fromarray(film[index]).quantize(palette=colors, dither=Image.Dither.NONE)

    colors = _colors(film[len(film) - 1])
    seen = round(1000 * film.period)
    with catch_interrupts() as asked:
        image(0).save(
            stream,
            format="GIF",
            save_all=True,
            append_images=(image(i) for i in range(1, len(film))),
            duration=[seen] * (len(film) - 1) + [_LAST],
            loop=0,
        )


def _colors(frame: Pixels) -> "Image.Image":
    """An image with the colours to use: those of a frame, and its background as it is, not almost."""
    from PIL import Image

    found = Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE)
    palette, background = np.reshape(found.getpalette() or (), (-1, 3)), frame[0, 0].astype(int)
    palette[(np.abs(palette - background) < _COLOR_DISTANCE).all(axis=1)] = background
    found.putpalette(palette.ravel().tolist())
    return found

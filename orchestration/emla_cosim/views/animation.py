"""Animations of results as GIF, registered for the signals that a run has."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import IO, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..base.errors import CommandError, RunError, join_names
from ..base.interruption import catch_interrupts
from ..base.progress import Progress

if TYPE_CHECKING:
    from PIL import Image

    from ..run.result import Result

Pixels = npt.NDArray[np.uint8]
"""A frame: rows, columns, and red, green and blue."""

_LAST_DURATION = 1500
"""Duration of the last frame in ms, before the animation repeats."""

_COLOR_DISTANCE = 8
"""Colours that differ by less, of 255, become one when Pillow looks for the nearest."""


class Film(ABC):
    """The frames of an animation, drawn when they are requested. All have one size.

    `period` is the duration of a frame in s. All frames use the colours of the last one.
    """

    period: float

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of frames."""

    @abstractmethod
    def __getitem__(self, index: int) -> Pixels:
        """Return the frame at this position, from 0."""


class Animation(ABC):
    """Base of animations. `takes` describes the runs that they support."""

    takes: str

    @abstractmethod
    def signals(self, names: Collection[str], roles: Mapping[str, str]) -> Sequence[str] | None:
        """Return the signals that it needs from these names, or None if some are missing.

        `roles` are names by JOINT.ROLE.
        """

    @abstractmethod
    def film(self, result: "Result") -> Film:
        """Return the film of a run with these signals. Raise RunError if there is nothing to show."""


ANIMATIONS: dict[str, Animation] = {}
"""Animations by file name, for runs that have their signals."""


def check_animated(
    name: str, all_names: Collection[str], recorded: Collection[str], roles: Mapping[str, str]
) -> None:
    """Raise CommandError if the recorded signals of a run are not enough for an animation."""
    needed = [names for a in ANIMATIONS.values() if (names := a.signals(all_names, roles)) is not None]
    if not needed:
        takes = join_names(a.takes for a in ANIMATIONS.values())
        raise CommandError(f"'{name}' cannot be animated: an animation needs {takes}.", name=name)
    missing = [[n for n in names if n not in recorded] for names in needed]
    if all(missing):
        raise CommandError(
            f"an animation needs signals that are not recorded: {join_names(missing[0])}.", missing=missing[0]
        )


def animate(
    result: "Result", write: Callable[[str], AbstractContextManager[IO[bytes]]], progress: Progress
) -> list[str]:
    """Draw all animations that the result has signals for, and return the names of their files.

    Args:
        result: The result.
        write: Opens a stream for the file of this name, as a context.
        progress: Where progress is reported.

    Raises:
        OSError: If a file cannot be written.
        RunError: If Ctrl-C interrupts it. There is no file then.
    """
    written = []
    for name, animation in ANIMATIONS.items():
        if animation.signals(result.names, result.roles) is not None:
            film = animation.film(result)
            progress.begin("animating", len(film))
            with write(file := f"{name}.gif") as stream:
                write_gif(film, stream, progress)
            written.append(file)
    return written


def write_gif(film: Film, stream: IO[bytes], progress: Progress) -> None:
    """Write a film that repeats forever. Raise RunError if Ctrl-C interrupts it."""
    from PIL import Image

    def make_image(frame_index: int) -> "Image.Image":
        if is_interrupted():
            raise RunError("the animation was interrupted.")
        progress.advance(1)
        return Image.fromarray(film[frame_index]).quantize(palette=colors, dither=Image.Dither.NONE)

    colors = _make_palette(film[len(film) - 1])
    frame_duration = round(1000 * film.period)
    with catch_interrupts() as is_interrupted:
        make_image(0).save(
            stream,
            format="GIF",
            save_all=True,
            append_images=(make_image(i) for i in range(1, len(film))),
            # the end stays visible before the animation repeats
            duration=[frame_duration] * (len(film) - 1) + [_LAST_DURATION],
            loop=0,
        )


def _make_palette(frame: Pixels) -> "Image.Image":
    """Return an image with the palette: the colours of a frame, with its background exactly."""
    from PIL import Image

    # small areas keep their colours, such as the path of the tip
    quantized = Image.fromarray(frame).quantize(
        256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    palette, background = np.reshape(quantized.getpalette() or (), (-1, 3)), frame[0, 0].astype(int)
    # else the background would flicker between two nearly equal colours
    palette[(np.abs(palette - background) < _COLOR_DISTANCE).all(axis=1)] = background
    quantized.putpalette(palette.ravel().tolist())
    return quantized

"""Animations of any film: frames, their durations, and progress."""

from io import BytesIO

import numpy as np
from PIL import Image, ImageSequence

from emla_cosim.base.progress import Progress
from emla_cosim.views.animation import Film, Pixels, write_gif


class Square(Film):
    """A square that goes right on a light ground, in a colour of its own."""

    period = 0.1

    def __len__(self) -> int:
        return 12

    def __getitem__(self, index: int) -> Pixels:
        frame = np.full((40, 60, 3), (251, 255, 249), dtype=np.uint8)
        frame[10:20, 2 + 4 * index : 12 + 4 * index] = (47, 109, 179)
        return frame


class Counted(Progress):
    count = 0

    def advance(self, count: int) -> None:
        self.count += count


def test_frames_in_the_file_equal_those_of_the_film() -> None:
    stream, progress = BytesIO(), Counted()
    write_gif(Square(), stream, progress)
    assert progress.count == 12
    with Image.open(stream) as actual:
        assert (actual.format, actual.info["loop"]) == ("GIF", 0)
        frames = [(f.info["duration"], np.asarray(f.convert("RGB"))) for f in ImageSequence.Iterator(actual)]
    assert len(frames) == 12
    assert [duration for duration, _ in frames] == 11 * [100] + [1500]
    for index, (_, frame) in enumerate(frames):
        assert np.array_equal(frame, Square()[index])

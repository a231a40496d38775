"""Animations of any film: frames, progress, Ctrl-C, and missing signals."""

import os
import signal
from collections.abc import Callable
from io import BytesIO

import numpy as np
import pytest
from PIL import Image, ImageSequence

from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.base.progress import Progress
from emla_cosim.views.animation import Film, Pixels, check_animated, write_gif
from tests.support.hdrm_runs import MACHINE_ROLES


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
    def __init__(self, each: Callable[[int], None] = lambda _: None) -> None:
        self.count, self._each = 0, each

    def advance(self, count: int) -> None:
        self.count += count
        self._each(self.count)


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


def test_ctrl_c_ends_it_between_two_frames() -> None:
    def end(count: int) -> None:
        if count == 5:
            os.kill(os.getpid(), signal.SIGINT)

    progress = Counted(end)
    with pytest.raises(RunError, match="the animation was interrupted"):
        write_gif(Square(), BytesIO(), progress)
    assert progress.count == 5


def test_missing_signals_are_named() -> None:
    joints = ("lift", "tilt", "telescope")
    names = [f"{joint}.plant.x_L" for joint in joints]
    names += [f"machine.{x}[{i}]" for x in ("trajectory.x_d", "manipulator.F_L") for i in (1, 2, 3)]
    check_animated("it", names, names, MACHINE_ROLES)
    with pytest.raises(CommandError) as caught:
        check_animated("it", names, names[2:], MACHINE_ROLES)
    words = "an animation needs signals that are not recorded: lift.plant.x_L and tilt.plant.x_L."
    assert str(caught.value) == words

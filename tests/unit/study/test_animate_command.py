"""`emla run --animate` writes a GIF, or one message on missing signals."""

import os
import signal
from pathlib import Path

import pytest
from PIL import Image

from emla_cosim.study.sketch.machine_picture import MachineFilm
from emla_cosim.views.animation import Pixels
from tests.support.commands import Emla, sentence
from tests.support.whole_files import names

RUN = ("run", "hdrm-replay", "--stop-time", "0.4", "--no-plots", "--output", "out")


def test_run_writes_a_gif_that_the_next_run_removes(emla: Emla) -> None:
    result = emla(*RUN, "--animate")
    assert result.exit_code == 0, result.output
    assert "manipulator.gif" in result.stdout
    with Image.open("out/manipulator.gif") as animation:
        assert (animation.format, getattr(animation, "n_frames", 0)) == ("GIF", 5)
        assert animation.info["duration"] == 80
    assert emla(*RUN).exit_code == 0  # which removes what an earlier run left
    assert names(Path("out")) == {"results.csv", "metrics.json", "run.json"}


def test_ctrl_c_while_drawing_keeps_the_results(emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = MachineFilm.__getitem__

    def ended(film: MachineFilm, index: int) -> Pixels:
        if index == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return drawn(film, index)

    monkeypatch.setattr(MachineFilm, "__getitem__", ended)
    text = sentence(emla(*RUN, "--animate"), 1)
    assert text == "Error: the animation was interrupted. The results so far are in out."
    files = names(Path("out"))
    assert files == {"results.csv", "metrics.json", "run.json"}


def test_missing_signals_are_reported(emla: Emla) -> None:
    text = sentence(emla(*RUN, "--animate", "--signals", "machine.*"), 2)
    assert "not recorded: lift.plant.x_L, tilt.plant.x_L and telescope.plant.x_L." in text
    assert not any(Path("out").iterdir())

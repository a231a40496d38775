"""Outcomes that come from the process of an FMU."""

import contextlib
import os
import pickle
import stat
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.base.tolerances import Comparison, Tube
from fmu_verify.check import RETURNS, CheckOutcome, Verdict, failed, passed
from fmu_verify.subprocess_run import CheckProcess, decode_outcome, encode_outcome


def test_outcome_survives_writing_and_reading() -> None:
    values = np.array([0.1, np.nan, -np.inf, 5e-324])
    outside = Comparison(
        "x\udc80", "m", values, values, values, values, values, values, Tube(0.1, 0.2), 1 / 3, np.inf, None
    )
    sent = failed(
        "line\nof \x00 and \udcff",
        details=("a", "ä"),
        comparisons=(outside,),
        figures={"steps": np.int64(3), "worst": np.float64(0.1)},
        clause=RETURNS,
        gaps=("not judged",),
        blocks=False,
    )
    text = encode_outcome(sent)
    assert b"\n" not in text
    outcome_read = decode_outcome(text)
    (compared,) = outcome_read.comparisons
    assert np.array_equal(compared.lower, values, equal_nan=True)
    assert (compared.signal, compared.tube, compared.worst) == ("x\udc80", Tube(0.1, 0.2), 1 / 3)
    assert replace(outcome_read, comparisons=()) == replace(sent, comparisons=())


@pytest.mark.parametrize(
    "text",
    [b"", b"{}", b"[" * 100_000, b"\xff", b'{"verdict": "good", "sentence": ""}', pickle.dumps(passed("!"))],
)
def test_invalid_outcomes(text: bytes) -> None:
    with pytest.raises(ValueError):
        decode_outcome(text)


def _run(do: Callable[..., CheckOutcome], arguments: tuple[Any, ...], seconds: float) -> CheckOutcome:
    with contextlib.closing(CheckProcess(do, arguments, 2**31)) as process:
        return process.call((), seconds)


def _open_files() -> set[int]:
    return {int(path.name) for path in Path("/dev/fd").iterdir()}


def _write_to_examiner(other_descriptors: set[int], text: bytes) -> None:
    """Write into everything that leads to the examiner, as an FMU could."""
    for number in _open_files() - other_descriptors:
        with contextlib.suppress(OSError):
            if stat.S_ISFIFO(os.fstat(number).st_mode):
                os.write(number, text)


class _Touch:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Callable[..., None], tuple[Path]]:
        return Path.touch, (self._path,)


def _send_a_program(other_descriptors: set[int], path: Path) -> CheckOutcome:
    content = pickle.dumps(_Touch(path))
    _write_to_examiner(other_descriptors, len(content).to_bytes(4, "big") + content)
    return passed("It did no harm.")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Pipes have no number there.")
def test_answer_of_a_process_is_not_executed(tmp_path: Path) -> None:
    outcome_read = _run(_send_a_program, (_open_files(), tmp_path / "here"), 20.0)
    assert not (tmp_path / "here").exists()
    assert outcome_read.verdict == Verdict.FAILED
    assert outcome_read.sentence.startswith("It wrote into a file of this program")


def _begin_an_answer(other_descriptors: set[int]) -> CheckOutcome:
    _write_to_examiner(other_descriptors, b"\x00")
    time.sleep(60.0)
    return passed("It came to an end.")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Pipes have no number there.")
def test_unfinished_answer_times_out() -> None:
    start = time.monotonic()
    outcome_read = _run(_begin_an_answer, (_open_files(),), 1.0)
    assert time.monotonic() - start < 20.0
    assert outcome_read.verdict == Verdict.SKIPPED
    assert outcome_read.sentence.startswith("It did not finish within 1 s")

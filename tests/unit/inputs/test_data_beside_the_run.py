"""Data that cover a part of the run only: the run says which values hold, and for how long."""

from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.base.progress import Progress

STEP = {"step_size": 0.1, "stop_time": 1.0}


@pytest.mark.parametrize(
    ("times", "end", "remark"),
    [
        ((0.0, 1.0), "hold", ""),
        ((0.1, 0.9), "hold", ""),  # a step is not worth a remark
        ((0.5, 2.0), "hold", "the first values hold until 0.5 s (shift= moves the data)."),
        ((-1.0, 0.5), "hold", "the last values hold after 0.5 s (shift= moves the data)."),
        ((0.3, 0.5), "hold", "until 0.3 s, and the last values hold after 0.5 s (shift= moves the data)."),
        ((0.0, 0.5), "repeat", ""),
    ],
)
def test_values_that_hold_are_reported(
    times: tuple[float, float], end: str, remark: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    data = tmp_path / "u.csv"
    data.write_text("time [s],u\n" + "".join(f"{time},2.0\n" for time in times))
    source = ec.Input(data, {"Faulty.u": "u"}, end=end)
    with ec.load(str(faulty_fmu), **STEP, input=[source]).prepare() as simulation:
        for _ in range(2):
            actual = [text for text in simulation.run().remarks if "cover" in text]
            assert len(actual) == bool(remark) and all(remark in text for text in actual)


def test_sweep_reports_held_values_once(
    faulty_fmu: Path, tmp_path: Path, on_one_cluster: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    progress, notes = Progress(), list[str]()
    monkeypatch.setattr(progress, "note", notes.append)
    data = tmp_path / "u.csv"
    data.write_text("time [s],u\n0.5,1\n2,1\n")
    scenario = ec.load(str(faulty_fmu), **STEP, input=[ec.Input(data, {"Faulty.u": "u"})])
    ec.sweep(scenario, {"Faulty.b": [1.0, 2.0]}, metrics=["y = last(Faulty.y)"], progress=progress)
    assert sum("the first values hold until 0.5 s" in text for text in notes) == 1

"""FMUs that do what the standard says, but not what they did."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

import emla_cosim as ec
from fmu_verify.references.reference_files import read_columns
from fmu_verify.settings import Settings
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.examining import examine

Columns = dict[str, np.ndarray]
_NARROW = Settings(tolerance={"*": ec.Tolerance(2e-5, time=0.0)})


def _with_reference(name: str, change: Callable[[Columns], object]) -> Callable[[Path], Path]:
    """Builds the good FMU with a reference that it agreed with before `change`."""

    def build(folder: Path) -> Path:
        path = build_good_fmu(folder, name=name)
        assert examine(path, settings=Settings(recording=ec.Recording(folder)), apart=()).passed
        file = folder / f"{name}_ref.csv"
        columns, _ = read_columns(file, "the reference")
        change(columns)
        rows = np.column_stack(list(columns.values()))
        np.savetxt(file, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
        return path

    return build


def _drift(columns: Columns) -> None:
    time, y = columns["time"], columns["position"]
    columns["position"] = y - 1e-4 * np.ptp(y) * time / time[-1]


def _spike(columns: Columns) -> None:
    y = columns["position"].copy()
    y[len(y) // 2] += 0.1 * np.ptp(y)
    columns["position"] = y


def _late(columns: Columns) -> None:
    time = columns["time"]
    columns["position"] = np.interp(time - 3.0 * (time[1] - time[0]), time, columns["position"])


# fmt: off
NUMERIC: list[Broken] = [
    Broken("drift", "the result drifts by 1e-4 of its range", "reference.agrees",
        _with_reference("Drift", _drift), _NARROW),
    Broken("spike", "one value of the result is off by 10 % of its range", "reference.agrees",
        _with_reference("Spike", _spike)),
    Broken("late", "the result is three steps early", "reference.agrees", _with_reference("Late", _late)),
]
# fmt: on

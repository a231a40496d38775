"""How the stepper in C is built, kept in the cache and loaded."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.stepper import library
from emla_cosim.stepper.library import StepperBuildError, StepperLibrary
from fmublock import cache
from fmublock.platforms import host_platform

Load = Callable[[], StepperLibrary]


@pytest.fixture(scope="module")
def built() -> bytes:
    """Return the library, which takes seconds to build."""
    return library.prebuild_stepper(host_platform()).read_bytes()


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Load the stepper with an empty cache and nothing prebuilt, as a new process would."""
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "PREBUILT", tmp_path / "prebuilt")
    return library.load_stepper.__wrapped__


def works(stepper: StepperLibrary) -> bool:
    """Return whether its pass over rows has the smallest value of each column."""
    rows, (low, high, squares) = (
        np.array([[2.0, -1.0], [1.0, 5.0]]),
        np.array([[np.inf] * 2, [-np.inf] * 2, [0.0] * 2]),
    )
    stepper.reduce_rows(rows.ctypes.data, 2, 2, low.ctypes.data, high.ctypes.data, squares.ctypes.data)
    return low.tolist() == [1.0, -1.0]


def test_library_is_built_once_and_again_if_corrupt(
    built: bytes, load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builds = list[int]()
    monkeypatch.setattr(library, "_build", lambda *_: (builds.append(1), built)[1])
    assert works(load()) and works(load())
    assert len(builds) == 1
    (path,) = (tmp_path / "cache" / "code").iterdir()
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "another"))  # the first file stays loaded
    damaged = tmp_path / "another" / "code" / path.name
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"no library")
    stepper = load()
    assert works(stepper) and len(builds) == 2
    assert stepper.why_not_kept == ""


@pytest.mark.slow
def test_library_of_a_wheel_is_used(load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prebuilt = library.prebuild_stepper(host_platform())
    (tmp_path / "cache").rename(tmp_path / "prebuilt")
    monkeypatch.setattr(library, "_build", lambda *arguments: pytest.fail("it is built"))
    assert works(load())
    assert not (tmp_path / "cache").exists()
    monkeypatch.undo()
    monkeypatch.setattr(cache, "PREBUILT", tmp_path / "wheel")  # what it has fits no machine
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "another"))
    damaged = tmp_path / "wheel" / "code" / prebuilt.name
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"no library")
    assert works(load())
    assert (tmp_path / "another" / "code" / prebuilt.name).is_file()


@pytest.mark.skipif(os.name == "nt", reason="a link to a file of the system")
def test_a_cache_that_cannot_be_used_is_reported(
    built: bytes, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "_build", lambda *_: built)
    monkeypatch.setenv("EMLA_COSIM_CACHE", "/dev/null/cache")
    stepper = load()
    assert works(stepper)
    assert "/dev/null/cache" in stepper.why_not_kept


EMPTY = {"library.c": b"", "halves.c": b"int y;", "system.c": b"int z;"}


@pytest.mark.parametrize(
    ("attribute", "value", "problem"),
    [
        pytest.param("SIZES", (1,), "the records in C have sizes", marks=pytest.mark.slow),
        ("TARGETS", {}, "there is no compiler for the platform"),
        ("read_native_sources", lambda: {**EMPTY, "library.c": b"int x = ;"}, "the C compiler failed"),
        ("read_native_sources", lambda: {**EMPTY, "library.c": b"int x;"}, "cannot be loaded"),
    ],
)
def test_build_and_load_errors_are_raised(
    attribute: str, value: object, problem: str, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, attribute, value)
    with pytest.raises(StepperBuildError, match=problem):
        load()

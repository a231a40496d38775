"""What is frozen of a command: exit code, files, keys of its records, bits and values of its tables."""

import ctypes
import ctypes.util
import hashlib
import io
import json
import math
import os
import sys
import zipfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import polars

from tests.support.paths import ROOT

FOLDER = Path(__file__).parent
FILE = FOLDER / "frozen.json"
WRITE = "EMLA_WRITE_FROZEN"
"""Set by `python -m tests.frozen`: tests then write what they would compare."""

DIGITS = 6
"""Significant digits of values, which other mathematical libraries keep."""

MOST_VALUES = 20
"""Values that are compared of a table, evenly spread over its columns."""

TABLES_BY_NAME = {
    "joints",
    "components",
    "signals",
    "parameters",
    "changed",
    "set",
    "coupling",
    "units",
    "step_multiples",
}
"""Keys of tables by name: of joints, components, variables."""


NOT_FROZEN = {"compiled_code_not_kept", "lanes"}
"""Keys that depend on the machine: whether its cache can be written, and a run takes several threads."""


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file; of an archive that of its content, also of the FMUs in it.

    The comments of FMUs contain a key that changes with any source of fmublock.
    """
    return _sha256(path.read_bytes())


def _sha256(content: bytes) -> str:
    if not zipfile.is_zipfile(io.BytesIO(content)):
        return hashlib.sha256(content).hexdigest()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = [f"{name} {_sha256(archive.read(name))}" for name in archive.namelist()]
    return hashlib.sha256("\n".join(entries).encode()).hexdigest()


def machine() -> dict[str, str]:
    """Return what bits depend on beside this project: mathematical libraries and compilers of FMUs."""
    return {
        "libm": _libm() if sys.platform == "linux" else sys.platform,
        "casadi": version("casadi"),
        "ziglang": version("ziglang"),
        "pythonfmu": version("pythonfmu"),
        "fmpy": version("fmpy"),
        "blas": _blas(),
    }


def _libm() -> str:
    """Return a fingerprint of the functions that equations call; processors get different versions."""
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    lines = []
    for name in ("sin", "cos", "exp", "log", "tanh", "sqrt"):
        function = getattr(library, name)
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
        lines += [function(math.fmod(0.37 + 1.618 * k, 30.0)).hex() for k in range(2000)]
    return hashlib.sha256("".join(lines).encode()).hexdigest()[:16]


def _blas() -> str:
    """Return a fingerprint of the linear algebra that iterations use; processors get different kernels."""
    matrix = np.sin(0.37 + 1.618 * np.arange(900.0)).reshape(30, 30)
    products = [matrix[:n, :n] @ matrix[:n, n - 1] for n in range(1, 31)]
    products += [np.linalg.qr(matrix[:, :n]).R.ravel() for n in range(1, 31)]
    return hashlib.sha256(np.concatenate(products).tobytes()).hexdigest()[:16]


def keys(value: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of keys, at most three deep, with * for names of joints, components and variables."""
    if isinstance(value, dict) and path.count("/") < 3:
        for key, inner in value.items():
            if key in NOT_FROZEN:
                continue
            key_path = f"{path}/{'*' if path.rpartition('/')[2] in TABLES_BY_NAME or '.' in key else key}"
            yield key_path
            yield from keys(inner, key_path)
    elif isinstance(value, list):
        for inner in value:
            yield from keys(inner, path)


def keys_of(path: Path) -> list[str]:
    """Return the different key paths of a JSON file."""
    return sorted(set(keys(json.loads(path.read_text(encoding="utf-8")))))


def last_row(path: Path) -> dict[str, float]:
    """Return numbers of the last row of a table, to `DIGITS` significant digits."""
    table = polars.read_parquet(path) if path.suffix == ".parquet" else polars.read_csv(path)
    row = table.row(-1, named=True)
    numbers = {n: v for n, v in row.items() if isinstance(v, float) and "wall" not in n}
    compared = list(numbers)[:: 1 + len(numbers) // MOST_VALUES]
    return {name: float(f"{numbers[name]:.{DIGITS}g}") for name in compared}


class Frozen:
    """The content of frozen.json: compared, or written with `EMLA_WRITE_FROZEN`."""

    def __init__(self) -> None:
        self.is_written = WRITE in os.environ
        self.content: dict[str, Any] = json.loads(FILE.read_text()) if FILE.exists() else {}

    def has_bits_of_this_machine(self, iterates: bool = False) -> bool:
        """Return whether bits were frozen with the same mathematical library and compilers.

        Args:
            iterates: Whether bits also depend on linear algebra.
        """
        ignored = set() if iterates else {"blas"}
        actual = machine()
        return self.is_written or all(
            actual[part] == frozen for part, frozen in self.content["machine"].items() if part not in ignored
        )

    def check(self, kind: str, name: str, actual: Any) -> None:
        """Compare something with what is frozen. Raise AssertionError if it differs."""
        if self.is_written:
            self.content.setdefault(kind, {})[name] = actual
            self.content["machine"] = machine()
            self._write()
            return
        expected = self.content.get(kind, {}).get(name)
        differences = set(actual) ^ set(expected or ()) if isinstance(actual, list) else actual
        assert actual == expected, (
            f"{kind} of '{name}' is not as in {FILE.relative_to(ROOT)}: {differences}. If this is wanted, "
            "run `python -m tests.frozen`, and say in CHANGELOG.md what changed."
        )

    def _write(self) -> None:
        """Write one line for each entry, so that a difference shows what changed."""
        kinds = [
            f"{json.dumps(kind)}: {{\n"
            + ",\n".join(
                f" {json.dumps(n)}: {json.dumps(v, sort_keys=True)}" for n, v in sorted(entries.items())
            )
            + "\n}"
            for kind, entries in sorted(self.content.items())
        ]
        FILE.write_text("{\n" + ",\n".join(kinds) + "\n}\n", encoding="utf-8")

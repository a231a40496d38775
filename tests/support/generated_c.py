"""Generated C code, compiled and called by the names of its signals."""

import ctypes
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

COMPILER = [
    *(sys.executable, "-m", "ziglang", "cc", "-std=c99"),
    *("-Wall", "-Wextra", "-Werror", "-ffp-contract=off"),
]


class Code:
    """An instance of C code that `export` wrote, by the fields in its header.

    `parameters`, `inputs` and `outputs` are its structures; `names` has the signal of each field.
    """

    def __init__(self, source: Path) -> None:
        self._name = name = source.stem
        library = source.with_suffix(".so")
        command = [*COMPILER, "-O2", "-fPIC", "-shared", "-o", str(library), str(source)]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        assert process.returncode == 0, process.stderr
        header = source.with_suffix(".h").read_text()
        real = ctypes.c_float if f"typedef float {name}_real" in header else ctypes.c_double
        self.library = ctypes.CDLL(str(library))
        self.parameters, self.inputs, self.outputs = (
            self._struct(header, kind, real) for kind in ("parameters", "inputs", "outputs")
        )
        self.names: dict[str, str] = dict(re.findall(r"_real (\w+); /\* ([\w.\[\],]+)", header))
        self._instance = ctypes.create_string_buffer(65536)
        getattr(self.library, f"{name}_start").restype = ctypes.c_char_p
        getattr(self.library, f"{name}_start").argtypes = [ctypes.c_void_p, real, *[ctypes.c_void_p] * 3]
        self._call("defaults", self.parameters, self.inputs)

    def _struct(self, header: str, kind: str, real: Any) -> Any:
        match = re.search(rf"typedef struct {self._name}_{kind} {{(.*?)}}", header, re.DOTALL)
        assert match is not None
        fields = re.findall(r"_real (\w+);", match[1])
        return type(kind, (ctypes.Structure,), {"_fields_": [(field, real) for field in fields]})()

    def _call(self, function: str, *arguments: Any) -> Any:
        return getattr(self.library, f"{self._name}_{function}")(*(ctypes.byref(a) for a in arguments))

    def start(self, time: float = 0.0) -> str | None:
        """Start at a time in s. Return the error message, if any."""
        call = getattr(self.library, f"{self._name}_start")
        structures = (ctypes.byref(x) for x in (self.parameters, self.inputs, self.outputs))
        wrong = call(ctypes.byref(self._instance), time, *structures)
        return None if wrong is None else wrong.decode()

    def step(self) -> bool:
        return bool(self._call("step", self._instance, self.inputs, self.outputs))

    def field(self, signal: str) -> str:
        return next(field for field, name in self.names.items() if name == signal)

    @property
    def signals(self) -> list[str]:
        """Names of the outputs."""
        return [self.names[field] for field, _ in type(self.outputs)._fields_]

    def output(self, signal: str) -> float:
        return getattr(self.outputs, self.field(signal))

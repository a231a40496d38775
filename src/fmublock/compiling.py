"""C sources of FMUs, how zig compiles them for any platform, and a watch on its process."""

import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from . import instance
from .cache import tool_environment
from .errors import BuildError
from .files import mark_of_process
from .platforms import FMI_VERSIONS, TARGETS, binaries_folder, zig_target

_FLAGS = [
    *("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fPIC", "-g0", "-s", "-Wall"),
    # square roots without a branch for errno, and one call for a sine and a cosine: up to a fifth faster
    *("-fno-math-errno", "-fno-slp-vectorize"),
]


def sources(folder: str, fmi: int = 2) -> dict[str, bytes]:
    """Return the C files in a folder of this package, by their path in an FMU of this version of FMI."""
    inside = files("fmublock").joinpath(folder)
    return {
        f"sources/{f.name}": f.read_bytes()
        for f in inside.iterdir()
        if f.name.endswith((".c", ".h")) and is_for(f.name, fmi)
    }


def is_for(name: str, fmi: int) -> bool:
    """Return whether a C file is needed for a version of FMI."""
    return not name.startswith(tuple(f"fmi{version}_" for version in FMI_VERSIONS if version != fmi))


def rename_folders(libraries: Mapping[str, bytes], fmi: int) -> dict[str, bytes]:
    """Return libraries by path, in the folders of a version of FMI."""
    renamed = {}
    for path, library in libraries.items():
        top, platform, name = path.split("/")
        renamed[f"{top}/{binaries_folder(platform, fmi)}/{name}"] = library
    return renamed


def compile_libraries(
    name: str,
    mains: Sequence[str],
    content: Mapping[str, bytes],
    platforms: Sequence[str],
    advance: Callable[[], None] = lambda: None,
    loads: bool = False,
) -> dict[str, bytes]:
    """Compile the libraries of an FMU.

    Args:
        name: The model identifier.
        mains: The source files to compile, relative to `sources/`; they include the others.
        content: The FMU's files by path.
        platforms: FMI platforms.
        advance: Called after each library.
        loads: Whether the library loads others.

    Returns:
        The libraries by path.

    Raises:
        BuildError: The compiler fails, or a platform is not supported.
        ModuleNotFoundError: The compiler is not installed.
    """
    if find_spec("ziglang") is None:
        raise ModuleNotFoundError("the compiler ziglang is not installed", name="ziglang")
    for platform in platforms:
        if platform not in TARGETS:
            raise BuildError(f"the platform '{platform}' is not supported; choose from {', '.join(TARGETS)}.")
    libraries, running = {}, list[subprocess.Popen[str]]()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        try:
            compiled = pool.map(partial(_compile, name, mains, content, running, loads), platforms)
            for platform, library in zip(platforms, compiled, strict=True):
                libraries[f"binaries/{platform}/{name}{TARGETS[platform][1]}"] = library
                advance()
        except BaseException:
            # also after Ctrl-C: compilers would continue, and keep their temporary folders
            pool.shutdown(wait=False, cancel_futures=True)
            for process in running:
                _end_process(process)
            raise
    return libraries


def _end_process(process: subprocess.Popen[str]) -> None:
    """End a compiler and the processes that it started."""
    if process.poll() is None:
        if sys.platform == "win32":
            process.kill()
        else:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def _compile(
    name: str,
    mains: Sequence[str],
    content: Mapping[str, bytes],
    running: list[subprocess.Popen[str]],
    loads: bool,
    fmi_platform: str,
) -> bytes:
    target, suffix = zig_target(fmi_platform), TARGETS[fmi_platform][1]
    headers = Path(str(files("fmpy"))) / "c-code"
    with tempfile.TemporaryDirectory(prefix=f"emla-build-{mark_of_process()}-") as folder:
        for file, text in content.items():
            if file.startswith("sources/"):
                source_file = Path(folder, file.removeprefix("sources/"))
                source_file.parent.mkdir(parents=True, exist_ok=True)
                source_file.write_bytes(text)
        output = f"{name}{suffix}"
        # mathematics are part of the C runtime of Windows
        libraries = [] if fmi_platform == "win64" else ["-lm"]
        libraries += ["-ldl"] if loads and "linux" in fmi_platform else []
        command = [sys.executable, "-m", "fmublock.compiling", str(os.getpid())]
        command += [sys.executable, "-m", "ziglang", "cc", "-target", target, "-shared", *_FLAGS]
        command += ["-I", str(headers), *mains, "-o", output, *libraries]
        environment = {**os.environ, **tool_environment()}
        with subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # in its own group, a compiler can be ended together with what it starts
            process_group=None if sys.platform == "win32" else 0,
        ) as process:
            running.append(process)
            _, errors = process.communicate()
        if process.returncode != 0:
            raise BuildError(f"the C compiler failed on {name} for {fmi_platform}: {errors.strip()}")
        return Path(folder, output).read_bytes()


def constants() -> list[str]:
    """Return what the shim shares with `Instance` as C: its numbers, and the phases with their names."""
    numbers = {
        "STEP_TOLERANCE": instance.STEP_TOLERANCE,
        "SAME_TIME": instance.SAME_TIME,
        "SAME_STEP": instance.SAME_STEP,
        "TIME_ROUNDING": instance.TIME_ROUNDING,
        "SAME_COUNT": instance.SAME_COUNT,
        "MAXIMUM_SUBSTEPS": instance.MAXIMUM_SUBSTEPS,
    }
    defined = [f"#define {name} {c_number(x)}" for name, x in numbers.items()]
    bits = ", ".join(f"{phase.name} = {phase.value}" for phase in instance.Phase)
    phases = [f'    {{{phase.name}, "{phase.name.lower().replace("_", "-")}"}},' for phase in instance.Phase]
    table = [
        "static const struct {",
        "    int bit;",
        "    const char *name;",
        "} phases[] = {",
        *phases,
        "};",
    ]
    return [*defined, f"enum {{ {bits} }};", *table]


def c_number(value: float) -> str:
    """Return a number as a C literal."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


def c_text(text: str) -> str:
    """Return a text as a C literal of its UTF-8 bytes."""
    escaped = {'"': '\\"', "\\": "\\\\", "?": "\\?"}  # two question marks can begin a trigraph
    plain = (escaped.get(chr(b), chr(b) if 32 <= b < 127 else f"\\{b:03o}") for b in text.encode("utf-8"))
    return f'"{"".join(plain)}"'


_CHECK_INTERVAL = 0.2
"""Seconds between two checks that the parent is alive."""


def main() -> None:
    """Run the command, and exit with its exit code."""
    parent, *command = sys.argv[1:]
    with subprocess.Popen(command) as compiler:
        while os.name == "nt" or os.getppid() == int(parent):
            try:
                sys.exit(compiler.wait(_CHECK_INTERVAL))
            except subprocess.TimeoutExpired:
                continue
        os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()

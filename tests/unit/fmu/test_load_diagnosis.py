"""Libraries that this machine cannot load: the reason, and what to do about it."""

import ctypes
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

import emla_cosim as ec
from emla_cosim.fmu.file import explain_missing_library
from emla_cosim.fmu.load_diagnosis import (
    diagnose_library,
    explain_python_needs,
    find_source,
    find_system_with_glibc,
    find_version_of_gcc,
)
from fmu_verify.check import Verdict
from fmublock.archive import write_archive
from tests.support.faulty_systems import faulty, open_system, wired

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="messages of the loader of Linux"
)


def compile_c(folder: Path, name: str, code: str, *options: str) -> Path:
    """Compile C to a library in a folder, which has no standard libraries."""
    (folder / "code.c").write_text(code)
    command = [sys.executable, "-m", "ziglang", "cc", "-shared", "-fPIC", "-nostdlib"]
    subprocess.run([*command, "code.c", "-o", name, *options], cwd=folder, check=True)
    return folder / name


def needing(folder: Path, library: str, function: str = "missing", *options: str) -> Path:
    """Compile a library that calls a function of another one."""
    compile_c(folder, library, f"int {function}(void) {{ return 1; }}", f"-Wl,-soname,{library}", *options)
    caller = f"int {function}(void);\nint (*fmi2GetVersion)(void) = {function};"
    (folder / "own").mkdir(exist_ok=True)
    return compile_c(folder, "own/Toy.so", caller, f"./{library}")


def diagnose(library: Path) -> str:
    with pytest.raises(OSError) as caught:
        ctypes.CDLL(str(library))
    fact, remedy = diagnose_library(library, caught.value)
    assert "\n" not in fact + remedy
    assert remedy.endswith(".")
    return f"{fact}. {remedy}"


def test_missing_library_is_named_with_its_package(tmp_path: Path) -> None:
    library = needing(tmp_path, "libgfortran.so.2")
    assert diagnose(library) == (
        "needs libgfortran.so.2, which this machine does not have. "
        "libgfortran.so.2 is in the Debian package libgfortran2."
    )


def test_all_missing_libraries_are_named(tmp_path: Path) -> None:
    for name in ("libmwmclmcrrt.so.9.14", "libnowhere.so.1"):
        function = name.partition(".")[0]
        compile_c(tmp_path, name, f"int {function}(void) {{ return 1; }}", f"-Wl,-soname,{name}")
    code = (
        "int libmwmclmcrrt(void), libnowhere(void);\nint f(void) { return libmwmclmcrrt() + libnowhere(); }"
    )
    (tmp_path / "own").mkdir()
    library = compile_c(tmp_path, "own/Toy.so", code, "./libmwmclmcrrt.so.9.14", "./libnowhere.so.1")
    text = diagnose(library)
    assert text.startswith(
        "needs libmwmclmcrrt.so.9.14 and libnowhere.so.1, which this machine does not have"
    )
    assert "MATLAB Runtime" in text
    assert "Install libnowhere.so.1" in text


def test_shipped_library_that_is_not_found(tmp_path: Path) -> None:
    library = needing(tmp_path, "libshipped.so")
    (tmp_path / "libshipped.so").rename(library.with_name("libshipped.so"))
    assert "although it is in the same folder. Report it to the exporter: " in diagnose(library)


def test_needed_and_local_glibc_are_reported(tmp_path: Path) -> None:
    (tmp_path / "versions").write_text("GLIBC_2.98 { };\nGLIBC_2.99 { strange; };\n")
    library = needing(tmp_path, "libc.so.6", "strange", "-Wl,--version-script=versions")
    local_glibc = ".".join(map(str, fmpy_glibc()))
    assert (
        f"needs glibc 2.99 (GLIBC_2.99); this machine has {local_glibc}. Run it on a newer system"
        in diagnose(library)
    )
    assert find_system_with_glibc("2.38").startswith("Ubuntu 24.04")
    assert find_version_of_gcc("GLIBCXX_3.4.32") == "13.2"


def fmpy_glibc() -> tuple[int, ...]:
    function = ctypes.CDLL(None).gnu_get_libc_version
    function.restype = ctypes.c_char_p
    return tuple(map(int, function().decode().split(".")))


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("aarch64-linux-gnu", "is for Linux on aarch64, but this machine is Linux on x86_64. "),
        ("x86-linux-gnu", "is for Linux on x86 (32 bits), but this machine is Linux on x86_64. "),
        ("x86_64-windows-gnu", "is for Windows on x86_64, but this machine is Linux on x86_64. "),
    ],
)
@pytest.mark.skipif(fmpy.platform != "linux64", reason="libraries for other machines than this one")
def test_library_for_another_machine(target: str, expected: str, tmp_path: Path) -> None:
    library = compile_c(tmp_path, "Toy.so", "int DllMainCRTStartup(void) { return 1; }", "-target", target)
    assert diagnose(library).startswith(expected)


def test_file_that_is_not_a_library(tmp_path: Path) -> None:
    (library := tmp_path / "Toy.so").write_text("not found\n" * 99)
    assert diagnose(library).startswith("is not a shared library. ")


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ("solve", "needs solve, which none of its libraries has. Report it to the exporter: "),
        ("PyUnicode_Strange", "needs PyUnicode_Strange of another version of Python than 3."),
    ],
)
def test_missing_symbol(function: str, expected: str, tmp_path: Path) -> None:
    library = needing(tmp_path, "libother.so", function)
    compile_c(library.parent, "libother.so", "int another;", "-Wl,-soname,libother.so")
    ctypes.CDLL(str(library.with_name("libother.so")))  # found, and without the function
    assert diagnose(library).startswith(expected)


@pytest.mark.parametrize(
    ("library", "part"),
    [
        ("libgfortran.so.5", "package libgfortran5"),
        ("libpython3.9.so.1.0", "package libpython3.9"),
        ("VCRUNTIME140.dll", "Visual C++ Redistributable"),
        ("libboost_log.so.1.74.0", "package libboost-log1.74.0"),
        ("libSimulationRuntimeC.so", "OpenModelica"),
        ("libmine.so", ""),
    ],
)
def test_sources_of_libraries(library: str, part: str) -> None:
    assert part in find_source(library)
    assert bool(find_source(library)) == bool(part)


def test_needs_of_fmus_with_python(tmp_path: Path) -> None:
    message = ["ModuleNotFoundError: No module named 'pythonfmu.builder'"]
    assert "needs the Python module 'pythonfmu'. " in explain_python_needs(tmp_path, message)
    assert sys.executable in explain_python_needs(tmp_path, message)
    assert explain_python_needs(tmp_path, ["other"]) == ""
    (tmp_path / "resources").mkdir()
    words = 'linux = ["python3", "launch.py"]\nmacos = ["python3"]\nwindows = ["python"]'
    (tmp_path / "resources" / "launch.toml").write_text(f"[command]\n{words}\n")
    assert "It starts the program `python3 launch.py` (UniFMU, " in explain_python_needs(tmp_path, [])
    (tmp_path / "resources" / "requirements.txt").write_text("zmq\n")
    assert "`pip install -r requirements.txt" in explain_python_needs(tmp_path, message)


def test_folder_of_the_platform_in_the_wrong_case(tmp_path: Path) -> None:
    (folder := tmp_path / "binaries" / fmpy.platform.title()).mkdir(parents=True)
    (folder / "Toy.so").touch()
    expected = f"the folder 'binaries/{folder.name}' must have the name '{fmpy.platform}'"
    assert explain_missing_library(tmp_path, "Toy").endswith(expected)


def test_run_and_verify_give_the_same_diagnosis(faulty_fmu: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(faulty_fmu) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    (library,) = (name for name in content if name.startswith("binaries/"))
    functions = [n.split(b"\0")[0].decode() for n in content[library].split(b"\0fmi2")[1:]]
    code = "\n".join(f"int fmi2{name}(void) {{ return 0; }}" for name in dict.fromkeys(functions))
    compile_c(tmp_path, "libgfortran.so.3", "int missing(void) { return 1; }", "-Wl,-soname,libgfortran.so.3")
    code += "\nint missing(void);\nint (*needed)(void) = missing;"
    content[library] = compile_c(tmp_path, "Toy.so", code, "./libgfortran.so.3").read_bytes()
    write_archive(fmu := tmp_path / "Faulty.fmu", content)
    reason = "needs libgfortran.so.3, which this machine does not have"
    with (
        pytest.raises(ec.CommandError, match=r"of j\.f cannot be started: its library ") as caught,
        open_system(wired([faulty("j.f", fmu)])),
    ):
        pass
    assert f"{reason}. libgfortran.so.3 is in the Debian package libgfortran3." in str(caught.value)
    finding = ec.verify(fmu, only=["binaries.loads"])[fmu]["binaries.loads"]
    assert finding.verdict == Verdict.FAILED
    assert reason in finding.sentence
    assert finding.hint == "libgfortran.so.3 is in the Debian package libgfortran3."

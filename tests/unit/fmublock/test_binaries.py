"""What the binaries for all platforms ask of the machine that loads them (read by LIEF)."""

import re
import zipfile
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

import lief
import pytest

from emla_cosim.fmu.models import build
from fmublock.platforms import TARGETS
from tests.support.blocks import FACTS, OWN

WINDOWS_SYSTEM_DLLS = re.compile(r"(kernel32|ntdll|api-ms-win-crt-[a-z]+-l1-1-0)\.dll", re.IGNORECASE)
GLIBC = (2, 17)  # of 2012; what every Linux of the last decade has


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU for all platforms."""
    return build("EmlaObserver", "native", list(TARGETS), tmp_path_factory.mktemp("platforms"))


def binary(fmu: Path, platform: str) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read(f"binaries/{platform}/{fmu.stem}{TARGETS[platform][1]}")


def fmi_functions(names: Iterable[object]) -> set[str]:
    """FMI functions among exported names; on the Mac C names begin with an underscore."""
    return {n for n in (str(name).lstrip("_") for name in names) if n.startswith("fmi2")}


def standard_functions() -> set[str]:
    header = (Path(str(files("fmpy"))) / "c-code" / "fmi2Functions.h").read_text()
    return set(re.findall(r"FMI2_Export\s+fmi2\w+TYPE\s+(fmi2\w+);", header, re.MULTILINE))


@pytest.mark.slow
def test_fmu_for_all_platforms_stays_under_a_megabyte(fmu: Path) -> None:
    assert fmu.stat().st_size < 1_000_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("platform", "architecture"),
    [("linux64", lief.ELF.ARCH.X86_64), ("aarch64-linux", lief.ELF.ARCH.AARCH64)],
)
def test_linux_binaries_need_nothing_newer_than_glibc_2_17(
    fmu: Path, platform: str, architecture: object
) -> None:
    elf = lief.ELF.parse(list(binary(fmu, platform)))
    assert elf is not None and elf.header.machine_type == architecture
    assert {str(s.name) for s in elf.exported_symbols} == standard_functions()
    assert set(elf.libraries) <= {"libc.so.6", "libm.so.6"}
    versions = [aux.name for need in elf.symbols_version_requirement for aux in need.get_auxiliary_symbols()]
    assert versions
    for version in versions:
        assert tuple(int(x) for x in re.findall(r"\d+", str(version))) <= GLIBC, version


@pytest.mark.slow
def test_windows_binaries_need_system_dlls_only(fmu: Path) -> None:
    pe = lief.PE.parse(list(binary(fmu, "win64")))
    assert pe is not None and pe.header.machine == lief.PE.Header.MACHINE_TYPES.AMD64
    export = pe.get_export()
    assert export is not None and {str(e.name) for e in export.entries} == standard_functions()
    assert pe.imports
    assert [str(i.name) for i in pe.imports if not WINDOWS_SYSTEM_DLLS.fullmatch(str(i.name))] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("platform", "architecture"),
    [("darwin64", lief.MachO.Header.CPU_TYPE.X86_64), ("aarch64-darwin", lief.MachO.Header.CPU_TYPE.ARM64)],
)
def test_mac_binaries_need_the_system_library_only(fmu: Path, platform: str, architecture: object) -> None:
    universal = lief.MachO.parse(list(binary(fmu, platform)))
    assert universal is not None
    macho = universal.at(0)
    assert macho is not None and macho.header.cpu_type == architecture
    assert fmi_functions(s.name for s in macho.exported_symbols) == standard_functions()
    identifiers = lief.MachO.LoadCommand.TYPE
    needed = [str(x.name) for x in macho.libraries if x.command != identifiers.ID_DYLIB]
    assert needed == ["/usr/lib/libSystem.B.dylib"]
    assert macho.build_version is not None and macho.build_version.minos == [11, 0, 0]
    # without a signature, if only an ad-hoc one, macOS on ARM kills the process that loads it
    assert macho.has_code_signature or platform == "darwin64"


def test_models_that_are_sampled_only_have_no_model_exchange_functions(fmu_folder: Path) -> None:
    for model in OWN:
        elf = lief.ELF.parse(list(binary(fmu_folder / model / f"{model}.fmu", "linux64")))
        assert elf is not None
        names = fmi_functions(s.name for s in elf.exported_symbols)
        assert "fmi2DoStep" in names and set(elf.libraries) <= {"libc.so.6", "libm.so.6"}
        assert ("fmi2GetDerivatives" in names) == FACTS[model].has_model_exchange

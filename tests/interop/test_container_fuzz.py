"""Random calls of systems as one FMU, for both versions of FMI, watched by the sanitizers.

Every call depends on a fixed seed. With other seeds and numbers of calls:

    EMLA_FUZZ_CALLS=200000 EMLA_FUZZ_SEED=2 pytest -m long tests/interop/test_container_fuzz.py
"""

import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import fmpy
import pytest

from emla_cosim.study.loading import load
from tests.emla_cosim.test_containers import without_sources
from tests.support.c_programs import SANITIZERS, needs_cc, without_randomization
from tests.support.sessions import ERROR

pytestmark = [needs_cc, pytest.mark.long]

CALLS = os.environ.get("EMLA_FUZZ_CALLS", "20000")
SEED = os.environ.get("EMLA_FUZZ_SEED", "1")
LETTERS = {"Real": "R", "Float64": "R", "Integer": "I", "Int32": "I", "Boolean": "B", "String": "S"}
_FLAGS = ["-std=c11", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-function"]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("system", ["lift", "hdrm-coupled"])
def test_random_calls_do_no_harm(system: str, fmi: int, fmu_folder: Path, tmp_path: Path) -> None:
    """The joint has a plant without sources, so that a library is loaded; the machine has loops."""
    plant = without_sources(fmu_folder / "EmlaPlant/EmlaPlant.fmu", tmp_path / "Plant.fmu")
    replace = {"lift.plant": plant} if system == "lift" else {}
    scenario = load(system, replace=replace, stop_time=0.1, fmus=fmu_folder)
    fmu, folder = scenario.export(tmp_path / "system.fmu", fmi=fmi), tmp_path / "fuzzed fmu"
    fmpy.extract(str(fmu), str(folder))
    library, sources = folder / "system.so", folder / "sources"
    mains = sorted(path.name for path in sources.glob("*.c"))
    headers, shared = str(files("fmpy").joinpath("c-code")), ["-shared", "-fPIC", "-fvisibility=hidden"]
    command = ["cc", *_FLAGS, *SANITIZERS["address"], *shared, "-I", headers, *mains, "-o", str(library)]
    subprocess.run([*command, "-lm", "-ldl"], cwd=sources, check=True)
    description, resources = fmpy.read_model_description(str(fmu)), folder / "resources"
    letters = LETTERS | {"Enumeration": "E" if fmi == 3 else "I"}
    run = subprocess.run(
        [
            *without_randomization(),
            sys.executable,
            str(files("tests.support").joinpath("container_calls.py")),
            str(fmi),
            str(library),
            str(description.guid),
            resources.as_uri() if fmi == 2 else f"{resources}/",
            "".join(letters[v.type] for v in description.modelVariables),
            SEED,
            CALLS,
        ],
        env={
            **os.environ,
            "LD_PRELOAD": subprocess.check_output(["cc", "-print-file-name=libasan.so"], text=True).strip(),
            "PYTHONMALLOC": "malloc",
            "ASAN_OPTIONS": "detect_leaks=1",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    print(run.stdout)
    assert (run.returncode, run.stderr) == (0, "")
    counts = {name: [int(n) for n in numbers] for name, *numbers in map(str.split, run.stdout.splitlines())}
    number = "Real" if fmi == 2 else "Float64"
    state = "state" if fmi == 2 else "State"
    for function in ("DoStep", f"Get{number}", f"Set{number}", f"GetFMU{state}", f"SetFMU{state}"):
        assert counts[function][0] > 0 and counts[function][ERROR] > 0, function

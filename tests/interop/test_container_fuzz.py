"""Random calls of systems as one FMU, for both versions of FMI, watched by the sanitizers.

Every call depends on a fixed seed. With other seeds and numbers of calls:

    EMLA_FUZZ_CALLS=200000 EMLA_FUZZ_SEED=2 pytest -m "slow or nightly" tests/interop/test_container_fuzz.py
"""

import itertools
import os
import sys
from collections import defaultdict
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import pytest

import fmublock
from emla_cosim.fmu.models import MODELS
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.backends.test_containers import without_sources
from tests.support.c_programs import SANITIZERS, needs_cc, without_randomization
from tests.support.container_calls import STEP, TYPES_3
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_event_fmu
from tests.support.processes import run
from tests.support.sessions import ERROR
from tests.support.tiers import mostly_nightly

pytestmark = [needs_cc, pytest.mark.slow]

CALLS = os.environ.get("EMLA_FUZZ_CALLS", "3000")
SEED = os.environ.get("EMLA_FUZZ_SEED", "1")
COMBINATIONS = list(itertools.product(("lift", "parts of FMI 3.0", "events", "hdrm-coupled"), (2, 3)))
LETTERS = {
    "Real": "R",
    "Integer": "I",
    "String": "S",
    **{name: letter for name, (letter, _) in TYPES_3.items()},
}
_FLAGS = ["-std=c11", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-function"]


@pytest.mark.parametrize(
    ("system", "fmi"), mostly_nightly(COMBINATIONS, [COMBINATIONS[0], COMBINATIONS[3], COMBINATIONS[5]])
)
def test_random_calls_under_sanitizers(system: str, fmi: int, fmu_folder: Path, tmp_path: Path) -> None:
    """The joint has a plant without sources, so that a library is loaded; the machine has loops.

    Parts of FMI 3.0 have all types and arrays; a plant is one of them. Those with events have clocks, and
    inputs that the host sets, which change at ticks.
    """
    source: Any = system
    replace: dict[str, Path] = {}
    if system == "lift":
        replace["lift.plant"] = without_sources(
            fmu_folder / "EmlaPlant/EmlaPlant.fmu", tmp_path / "Plant.fmu"
        )
    elif system == "parts of FMI 3.0":
        third = build_all_types_3_fmu(tmp_path / "Third.fmu")
        plant = fmublock.build(MODELS["EmlaPlant"], tmp_path / "EmlaPlant.fmu", fmi=3)
        wires = [f"a.{kind}_out -> b.{kind}_in" for kind in ("Float32", "Int8", "UInt64", "Boolean")]
        fmus = {"a": third, "b": third, "plant": plant}
        wires += ["a.y -> b.u", "a.x -> plant.u_q", "plant.x_L -> a.u[1,1]"]
        wires += ["a.String_out -> b.String_in", "a.Binary_source -> b.Binary_in"]
        source = System.of(fmus, wires)
    elif system == "events":
        clocks = {"a": "periodic", "b": "countdown", "c": None}
        fmus = {
            name: build_event_fmu(tmp_path / f"{name}.fmu", clock=clock) for name, clock in clocks.items()
        }
        starts = {"a.period": 3.3 * STEP, "b.threshold": 2.7 * STEP, "c.threshold": 4.1 * STEP}
        source = System.of(fmus, ["a.x -> b.w", "a.count -> c.n"], starts)
    scenario = load(source, replace=replace, step_size=STEP, stop_time=0.1, fmus=fmu_folder)
    fmu, folder = scenario.export(tmp_path / "system.fmu", fmi=fmi), tmp_path / "fuzzed fmu"
    fmpy.extract(str(fmu), str(folder))
    library, sources = folder / "system.so", folder / "sources"
    mains = sorted(path.name for path in sources.glob("*.c"))
    headers, shared = str(files("fmpy").joinpath("c-code")), ["-shared", "-fPIC", "-fvisibility=hidden"]
    command = ["cc", *_FLAGS, *SANITIZERS["address"], *shared, "-I", headers, *mains, "-o", str(library)]
    run(*command, "-lm", "-ldl", cwd=sources, check=True)
    description, resources = fmpy.read_model_description(str(fmu)), folder / "resources"
    letters = defaultdict(lambda: "?", LETTERS | {"Enumeration": "E" if fmi == 3 else "I"})
    script = [*without_randomization(), sys.executable, files("tests.support").joinpath("container_calls.py")]
    place_of_resources = resources.as_uri() if fmi == 2 else f"{resources}/"
    types = "".join(letters[v.type] for v in description.modelVariables)
    runtime = run("cc", "-print-file-name=libasan.so").stdout.strip()
    environment = {"LD_PRELOAD": runtime, "PYTHONMALLOC": "malloc", "ASAN_OPTIONS": "detect_leaks=1"}
    numbers = (fmi, library, description.guid, place_of_resources, types, SEED, CALLS)
    process = run(*script, *numbers, environment=environment)
    print(process.stdout)
    assert (process.returncode, process.stderr) == (0, "")
    counts = {
        name: [*map(int, of_status)] for name, *of_status in map(str.split, process.stdout.splitlines())
    }
    number = "Real" if fmi == 2 else "Float64"
    state = "state" if fmi == 2 else "State"
    for function in ("DoStep", f"Get{number}", f"Set{number}", f"GetFMU{state}", f"SetFMU{state}"):
        assert counts[function][0] > 0 and counts[function][ERROR] > 0, function

"""Random calls with random arguments, right and wrong, on every model, watched by the sanitizers.

fuzz.c says what is called and checked. Every call depends on a fixed seed; a failure says how to
repeat its burst of calls alone. To fuzz every model for 60 s, with other seeds than those of CI:

    EMLA_FUZZ_SECONDS=60 EMLA_FUZZ_SEED=2 pytest -s -m "slow or nightly" tests/interop/test_fuzz.py
"""

import os
from pathlib import Path

import pytest

from emla_cosim.fmu.file import FmuFile
from emla_cosim.fmu.models import MODELS
from tests.interop.conftest import Compile
from tests.support.c_programs import fuzz_plan, needs_cc, run_program
from tests.support.tiers import mostly_nightly

pytestmark = [needs_cc, pytest.mark.slow]

SECONDS = float(os.environ.get("EMLA_FUZZ_SECONDS", "0.2"))
SEED = int(os.environ.get("EMLA_FUZZ_SEED", "1"))
FOREIGN = {model: "Disturbance" if model == "Reference" else "Reference" for model in MODELS}
"""The model whose states are given to each."""
OFTEN = ["EmlaPlant", "EmlaObserver", "RsbaController", "Reference", "Disturbance"]
"""Models of the slow tier."""


@pytest.mark.parametrize("model", mostly_nightly(MODELS, OFTEN))
def test_random_calls_under_sanitizers(
    model: str, compiled: Compile, unpacked_fmus: dict[str, FmuFile], tmp_path: Path
) -> None:
    plan, foreign = tmp_path / "plan", FOREIGN[model]
    build = compiled("address", "fuzz", (model, foreign))
    libraries = build.libraries
    plan.write_text(
        fuzz_plan(unpacked_fmus[model], libraries[model], unpacked_fmus[foreign], libraries[foreign])
    )
    output = run_program(build.programs["fuzz"], "-s", str(SEED), "-t", str(SECONDS), plan)
    print(f"{model}\n{output}")
    _, *lines = output.splitlines()
    counts = {name: [int(n) for n in numbers] for name, *numbers in map(str.split, lines)}
    # random calls that were all refused, or never made, would prove nothing
    assert [function for function, count in counts.items() if sum(count) == 0] == []
    for function in ("DoStep", "SetReal", "SetFMUstate", "DeSerializeFMUstate", "GetDirectionalDerivative"):
        ok, _, _, error = counts[f"fmi2{function}"]
        assert ok > 0 and error > 0, function

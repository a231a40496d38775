"""Run one FMU with one tool and keep its signals; `foreign_fmus.py` starts this in a process of its own."""

import json
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np


def run_fmpy(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the signals of `simulate_fmu` by name; arrays by element, such as `y[2,3]`."""
    from fmpy import simulate_fmu

    result = simulate_fmu(
        asked["fmu"],
        validate=asked["validate"],
        start_time=asked["start_time"],
        stop_time=asked["stop_time"],
        output_interval=asked["step_size"],
        step_size=asked["step_size"],
        remote_platform=None,
        record_events=False,
        fmi_type=asked["fmi_type"],
        relative_tolerance=asked.get("tolerance"),
        output=asked["signals"],
    )
    found = {}
    for name in result.dtype.names or ():
        values = result[name]
        for index in np.ndindex(values.shape[1:]) if values.dtype.kind in "fiub" else ():
            place = f"[{','.join(str(i + 1) for i in index)}]" if index else ""
            found[f"{name}{place}"] = values[(slice(None), *index)]
    return found


def run_emla(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the signals of a run in this master by the names of the FMU's variables."""
    import emla_cosim as ec

    options = {n: asked[n] for n in ("start_time", "stop_time", "step_size", "lenient") if n in asked}
    options["kind"] = {"*": "me" if asked["fmi_type"] == "ModelExchange" else "cs"}
    if "tolerance" in asked:
        options["fmi_tolerance"] = asked["tolerance"]
    with ec.load(asked["fmu"], output_interval=asked["step_size"], **options).prepare() as simulation:
        component = simulation.system.components[0].name
        more = {"signals": [f"{component}.{n}" for n in asked["signals"]]} if asked["signals"] else {}
        result = simulation.run(**more)
    read = result.read(["time", *result.names])
    kept = {n.removeprefix(f"{component}."): values for n, values in read.items()}
    return {n: v for n, v in kept.items() if np.asarray(v).dtype.kind in "fiub"}


def main(text: str) -> int:
    """Run, and write the signals or the reason of failure."""
    asked = json.loads(text)
    try:
        signals = {"fmpy": run_fmpy, "emla": run_emla}[asked["tool"]](asked)
    except BaseException as error:
        problems = getattr(error, "problems", None)
        print(f"\nFAILED {' '.join(str(problems[0] if problems else error).split())}", flush=True)
        return 1
    np.savez(asked["target"], **signals)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

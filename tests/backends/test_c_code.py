"""Components as plain C: the bits of their FMUs in FMPy, floats near them, targets, and what is refused.

That whole systems have the bits of a run is shown in test_matrix.py.
"""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app
from tests.backends.systems import Pid
from tests.support.generated_c import COMPILER, Code
from tests.support.tiers import mostly_slow

CONTROL = ["controller", "observer"]


def follow(code: Code, run: ec.Result, system: ec.System) -> np.ndarray:
    """Step the code with the inputs of a run. Return the outputs of each step, of the code and of the run."""
    sources = {".".join(target): ".".join(source) for source, target in (c.ends for c in system.connections)}
    driven = [(field, run[sources[code.names[field]]]) for field, _ in type(code.inputs)._fields_]
    rows, steps = [], len(run.time) - 1
    for k in range(steps + 1):
        for field, values in driven:
            setattr(code.inputs, field, values[k])
        if k == 0:
            assert code.start() is None
        rows.append([[code.output(signal), run[signal][k]] for signal in code.signals])
        assert k == steps or code.step()
    return np.array(rows).swapaxes(1, 2)


JOINTS: list[tuple[str, dict[str, Any]]] = [
    ("lift", {"set": {"lift.controller.beta[1]": 30.0, "lift.observer.alpha_1": 900.0}}),
    ("lift", {"controller": "foc"}),
    ("tilt", {"controller": "cac"}),
    ("telescope", {"controller": "anatc"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "options"), JOINTS, ids=str)
def test_code_of_components_does_what_they_do_in_a_run(
    joint: str, options: dict[str, Any], fmu_folder: Path, tmp_path: Path
) -> None:
    """Doubles have its bits; floats are near."""
    times = {"stop_time": 0.03, "output_interval": 1e-4, "algorithm": "jacobi"}
    scenario = ec.load(joint, fmus=fmu_folder, **times, **options)
    with scenario.prepare() as simulation:
        run, system = simulation.run(), simulation.system
    for precision in ("double", "float"):
        source = tmp_path / f"control_{precision}.c"
        scenario.export(source, components=CONTROL, precision=precision)
        code = Code(source)
        actual, expected = follow(code, run, system).swapaxes(0, 1)
        spread = np.ptp(expected, axis=0)
        assert (spread > 0.0).all()
        if precision == "double":
            assert actual.tobytes() == expected.tobytes()
            assert code.start(0.25) is None  # a second start forgets the first run
            assert code.output(code.signals[0]) != actual[-1, 0]
        else:
            error = np.median(np.abs(actual - expected), axis=0)
            assert (error < 0.02 * spread).all() and error.any()


@pytest.mark.parametrize(("joint", "step"), [("lift", 1e-4), ("prototype", 1e-3)])
def test_header_has_the_step_of_the_components(
    joint: str, step: float, fmu_folder: Path, tmp_path: Path
) -> None:
    source = tmp_path / "control.c"
    ec.load(joint, fmus=fmu_folder).export(source, components=CONTROL)
    definition = re.search(r"_STEP (\S+)", source.with_suffix(".h").read_text())
    assert definition is not None and float(definition[1]) == step


@pytest.mark.parametrize(
    ("first", "second"),
    mostly_slow(
        [("parameters", "signals"), ("a", "a_fixed"), ("a.b", "a_b"), ("count", "start_time"), ("int", "_")],
        [("a.b", "a_b")],
    ),
)
def test_components_may_have_any_names(first: str, second: str, tmp_path: Path) -> None:
    system = ec.System.of(dict.fromkeys([first, second], Pid), [f"{first}.u -> {second}.r"])
    source = tmp_path / "real.c"
    ec.load(system, step_size=0.01, stop_time=1.0).export(source, components=["*"])
    code = Code(source)
    assert code.start() is None and code.step()
    integer_field = next(field for field, name in code.names.items() if name == f"{second}.n")
    setattr(code.parameters, integer_field, 2.5)
    wrong = code.start()
    assert wrong is not None and wrong.startswith(f"{second}.n ") and "no whole number" in wrong


def test_invalid_parameter_is_named(fmu_folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "control.c"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL)
    code = Code(source)
    field = code.field("lift.controller.model.R_s")
    good = getattr(code.parameters, field)
    for value in (-1.0, float("nan")):
        setattr(code.parameters, field, value)
        assert code.start() == "lift.controller.model.R_s is outside of its range, 0 to inf."
    setattr(code.parameters, field, good)
    assert code.start() is None and code.step()
    setattr(code.inputs, code.field("lift.controller.x_d"), float("nan"))
    assert not code.step()
    setattr(code.inputs, code.field("lift.controller.x_d"), 0.1)
    assert code.start() is None and code.step()


@pytest.mark.slow
def test_parameters_in_c_match_set(fmu_folder: Path, tmp_path: Path) -> None:
    """A parameter that is set in C gives what the same one gives in the scenario."""
    results = []
    for number, options in ((1, {}), (2, {"set": {"lift.controller.beta[2]": 123.0}})):
        source = tmp_path / f"control{number}.c"
        ec.load("lift", fmus=fmu_folder, **options).export(source, components=CONTROL)
        code = Code(source)
        setattr(code.parameters, code.field("lift.controller.beta[2]"), 123.0)
        setattr(code.inputs, code.field("lift.controller.x_d"), 0.2)
        assert code.start() is None
        for _ in range(20):
            assert code.step()
        results.append([getattr(code.outputs, field) for field, _ in type(code.outputs)._fields_])
    assert results[0] == results[1] and any(results[0])


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    ("x.ssp", {"components": ["controller"]}, "an SSP cannot hold --components"),
    ("x.ssp", {"inputs": ["*"]}, "an SSP cannot hold --inputs"),
    ("x.ssp", {"fmi": 3}, "an SSP cannot hold --fmi"),
    ("x.fmu", {"precision": "float"}, "an FMU cannot hold --precision"),
    ("x.c", {"components": CONTROL, "platform": ["win64"]}, "a C file cannot hold --platform"),
    ("x.c", {"components": CONTROL, "fmi": 3}, "a C file cannot hold --fmi"),
    ("x.c", {}, "plain C needs --components, such as --components controller; there are lift."),
    ("x.c", {"components": ["gone"]}, "no component matches 'gone' of --components; there are lift."),
    ("x.c", {"components": ["disturbance"], "precision": "float"}, "float has them only up to 16777216"),
    (
        "x.c",
        {"components": CONTROL, "outputs": ["lift.plant.x_L"]},
        "no output matches 'lift.plant.x_L'; did you mean lift.controller.u_q",
    ),
    ("x.c", {"components": CONTROL, "algorithm": "strong"}, "plain C has no strong coupling; add"),
    ("x.c", {"components": CONTROL, "extrapolation": "fmu"}, "plain C does not extrapolate inputs; add"),
    (
        "x.c",
        {"components": CONTROL, "step_multiples": {"lift.observer": 2}},
        "have different step multiples: ",
    ),
    ("x.c", {"components": CONTROL, "precision": "half"}, "precision"),
    *(
        (name, {"components": CONTROL}, "begins all names in C")
        for name in ("my control.c", "1st.c", "int.c", "a-b.c")
    ),
]


@pytest.mark.parametrize(("name", "options", "message"), REFUSED)
def test_options_that_the_file_type_does_not_support(
    name: str, options: dict[str, Any], message: str, fmu_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(CommandError) as refused:
        ec.load("lift", fmus=fmu_folder).export(tmp_path / name, **options)
    assert message in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_fmu_file_cannot_be_plain_c(fmu_folder: Path, tmp_path: Path) -> None:
    fmu = shutil.copy(fmu_folder / "EmlaObserver/EmlaObserver.fmu", tmp_path / "mine.fmu")
    with pytest.raises(CommandError, match="is an FMU file; only blocks of Python can be plain C"):
        ec.load(str(fmu)).export(tmp_path / "out.c", components=["*"])


@pytest.fixture
def emla(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.chdir(tmp_path)
    return lambda *options: CliRunner().invoke(app, ["export", "lift", *options, "--fmus", str(fmu_folder)])


def test_command_writes_both_files_and_replaces_only_its_own(
    emla: Callable[..., Result], tmp_path: Path
) -> None:
    options = ("control.c", "--components", "controller", "--outputs", "lift.controller.*")
    result = emla(*options)
    assert result.exit_code == 0 and "control.c" in result.output and "control.h" in result.output
    first = (tmp_path / "control.c").read_bytes(), (tmp_path / "control.h").read_bytes()
    assert b"lift.controller.saturated" in first[1] and emla(*options).exit_code == 0
    assert first == ((tmp_path / "control.c").read_bytes(), (tmp_path / "control.h").read_bytes())
    (tmp_path / "control.h").write_text("mine")
    refused = emla(*options)
    assert refused.exit_code == 2 and "'control.h'" in refused.stderr
    assert (tmp_path / "control.h").read_text() == "mine"
    assert (tmp_path / "control.c").read_bytes() == first[0]
    assert emla(*options, "--overwrite").exit_code == 0
    assert (tmp_path / "control.h").read_bytes() == first[1]


def test_code_needs_only_the_mathematics_library(fmu_folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "control.c"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL)
    included = re.findall(r"#include (\S+)", source.read_text() + source.with_suffix(".h").read_text())
    assert included == ["<stddef.h>", "<tgmath.h>", '"control.h"']
    assert not re.search(r"\b(static (?!const|void|int|inline)|malloc|printf)", source.read_text())


def build(*arguments: Any) -> None:
    """Run the compiler for C."""
    command = [*COMPILER[:3], *map(str, arguments)]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr


@pytest.mark.slow
def test_program_in_cpp_can_call_it(fmu_folder: Path, tmp_path: Path) -> None:
    source, main = tmp_path / "control.c", tmp_path / "main.cpp"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL)
    main.write_text(
        '#include "control.h"\nint main() {\n    control_parameters p;\n    control_inputs u;\n'
        "    control_defaults(&p, &u);\n    return p.controller_beta_1 > 0.0 ? 0 : 1;\n}\n"
    )
    for kind, file, standard in (("cc", source, "-std=c99"), ("c++", main, "-std=c++11")):
        build(kind, standard, "-Wall", "-Werror", "-c", file, "-o", file.with_suffix(".o"))
    program = tmp_path / "program"  # which needs no C++ library
    build("cc", source.with_suffix(".o"), main.with_suffix(".o"), "-lm", "-o", program)
    assert subprocess.run([program], check=False).returncode == 0


FIRMWARE = """#include "control.h"
static control memory;
static control_parameters parameters;
volatile control_inputs given;
volatile control_outputs taken;
int main(void) {
    control_inputs u;
    control_outputs y;
    control_defaults(&parameters, &u);
    if (control_start(&memory, 0, &parameters, &u, &y)) return 1;
    for (;;) {
        u = given;
        if (!control_step(&memory, &u, &y)) return 2;
        taken = y;
    }
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
def test_it_links_for_a_cortex_m4(precision: str, fmu_folder: Path, tmp_path: Path) -> None:
    source, main, program = (tmp_path / name for name in ("control.c", "main.c", "control.elf"))
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL, precision=precision)
    main.write_text(FIRMWARE)
    target = ["-target", "thumb-linux-musleabihf", "-mcpu=cortex_m4", "-Os", "-static", "-s"]
    build(*COMPILER[3:], *target, source, main, "-o", program)
    assert program.stat().st_size < 200_000

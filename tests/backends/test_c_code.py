"""Components as plain C: the bits of their FMUs in FMPy, floats near them, targets, and what is refused."""

import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from typer.testing import CliRunner, Result

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app
from fmublock import Block, DiscreteState, Input, Output, Parameter, State, sin, where

COMPILER = [
    sys.executable,
    "-m",
    "ziglang",
    "cc",
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-ffp-contract=off",
]
CONTROL = ["controller", "observer"]


def compiled(source: Path, *flags: str) -> Path:
    library = source.with_suffix(".so")
    command = [*COMPILER, "-O2", "-fPIC", "-shared", *flags, "-o", str(library), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return library


class Code:
    """An instance of compiled C code, by the fields in its header."""

    def __init__(self, source: Path) -> None:
        self._name = name = source.stem
        header = source.with_suffix(".h").read_text()
        real = ctypes.c_float if f"typedef float {name}_real" in header else ctypes.c_double
        self.library = ctypes.CDLL(str(compiled(source)))
        self.parameters, self.inputs, self.outputs = (
            self._struct(header, kind, real) for kind in ("parameters", "inputs", "outputs")
        )
        self.names = {
            field: signal
            for signal, field in (
                (signal, field) for field, signal in re.findall(r"_real (\w+); /\* ([\w.\[\],]+)", header)
            )
        }
        self._memory = ctypes.create_string_buffer(65536)
        getattr(self.library, f"{name}_start").restype = ctypes.c_char_p
        getattr(self.library, f"{name}_start").argtypes = [ctypes.c_void_p, real, *[ctypes.c_void_p] * 3]
        self._call("defaults", self.parameters, self.inputs)

    def _struct(self, header: str, kind: str, real: Any) -> Any:
        found = re.search(rf"typedef struct {self._name}_{kind} {{(.*?)}}", header, re.DOTALL)
        assert found is not None
        fields = re.findall(r"_real (\w+);", found[1])
        return type(kind, (ctypes.Structure,), {"_fields_": [(field, real) for field in fields]})()

    def _call(self, function: str, *arguments: Any) -> Any:
        return getattr(self.library, f"{self._name}_{function}")(*(ctypes.byref(a) for a in arguments))

    def start(self, time: float = 0.0) -> str | None:
        call = getattr(self.library, f"{self._name}_start")
        places = (ctypes.byref(x) for x in (self.parameters, self.inputs, self.outputs))
        wrong = call(ctypes.byref(self._memory), time, *places)
        return None if wrong is None else wrong.decode()

    def step(self) -> bool:
        return bool(self._call("step", self._memory, self.inputs, self.outputs))

    def field(self, signal: str) -> str:
        return next(field for field, name in self.names.items() if name == signal)


class Chain:
    """Components of a joint as FMUs in FMPy, stepped one after the other."""

    def __init__(
        self, joint: str, fmus: Path, folder: Path, parts: Sequence[str] = CONTROL[::-1], **options: Any
    ) -> None:
        scenario = ec.load(joint, fmus=fmus, **options)
        system = scenario.prepare().system
        self.parts: dict[str, tuple[FMU2Slave, dict[str, int]]] = {}
        own = [f"{joint}.{part}" for part in parts]
        self.connections = [link.ends for link in system.connections]
        self.links = [((a, x), (b, y)) for (a, x), (b, y) in self.connections if a in own and b in own]
        for name in own:
            component = next(c for c in system.components if c.name == name)
            place = folder / name
            extract(str(fmus / str(component.model) / f"{component.model}.fmu"), unzipdir=str(place))
            description = read_model_description(str(place))
            instance = FMU2Slave(
                guid=description.guid,
                modelIdentifier=description.coSimulation.modelIdentifier,
                unzipDirectory=str(place),
                instanceName=name,
            )
            references = {v.name: v.valueReference for v in description.modelVariables}
            types = {v.name: v.type for v in description.modelVariables}
            instance.instantiate()
            instance.setupExperiment()
            for variable, value in component.parameters.items():
                values = np.ravel(value).tolist() if isinstance(value, (list, tuple)) else [value]
                names = (
                    [variable] if len(values) == 1 else [f"{variable}[{i + 1}]" for i in range(len(values))]
                )
                for one, number in zip(names, values, strict=True):
                    set_ = {"Real": instance.setReal, "Boolean": instance.setBoolean}.get(
                        types[one], instance.setInteger
                    )
                    set_([references[one]], [number])
            instance.enterInitializationMode()
            self.parts[name] = instance, references

    def pass_values(self, target: str) -> None:
        for (a, x), (b, y) in self.links:
            if b == target:
                source, theirs = self.parts[a]
                instance, own = self.parts[b]
                instance.setReal([own[y]], source.getReal([theirs[x]]))

    def set(self, signal: str, value: float) -> None:
        for name, (instance, references) in self.parts.items():
            if signal.startswith(f"{name}."):
                instance.setReal([references[signal.removeprefix(f"{name}.")]], [value])

    def start(self) -> None:
        for name in (*self.parts, *self.parts):
            self.pass_values(name)
        for instance, _ in self.parts.values():
            instance.exitInitializationMode()

    def step(self, time: float, step: float) -> None:
        for name, (instance, _) in self.parts.items():
            self.pass_values(name)
            instance.doStep(time, step)

    def get(self, signal: str) -> float:
        for name, (instance, references) in self.parts.items():
            if signal.startswith(f"{name}."):
                return float(instance.getReal([references[signal.removeprefix(f"{name}.")]])[0])
        raise KeyError(signal)

    def close(self) -> None:
        for instance, _ in self.parts.values():
            instance.terminate()
            instance.freeInstance()


SCALES = {"i_q": 50.0, "i_d": 5.0, "x_d": 0.1, "v_d": 0.05, "a_d": 0.1, "u_available": 300.0}


def drive(code: Code, chain: Chain, joint: str, steps: int, step: float, seed: int = 0) -> np.ndarray:
    """Drive both with the same noisy inputs, and return the outputs of each step: C, then FMUs."""
    random = np.random.default_rng(seed)
    inputs = [field for field, _ in type(code.inputs)._fields_]
    outputs = [field for field, _ in type(code.outputs)._fields_]
    rows = []

    def set_inputs(k: int) -> None:
        for field in inputs:
            signal = code.names[field]
            scale = SCALES.get(signal.rpartition(".")[2], 0.1)
            value = float(np.float32(scale * (np.sin(0.01 * k) + 0.01 * random.standard_normal())))
            setattr(code.inputs, field, value)
            chain.set(signal, value)

    set_inputs(0)
    chain.start()
    assert code.start() is None
    for k in range(steps + 1):
        rows.append(
            [[getattr(code.outputs, f) for f in outputs], [chain.get(code.names[f]) for f in outputs]]
        )
        set_inputs(k + 1)
        if k < steps:
            assert code.step()
            chain.step(k * step, step)
    chain.close()
    return np.array(rows)


@pytest.mark.parametrize(
    ("joint", "step", "options"),
    [
        ("lift", 1e-4, {}),
        ("prototype", 1e-3, {}),
        ("lift", 1e-4, {"set": {"lift.controller.beta[1]": 30.0, "lift.observer.alpha_1": 900.0}}),
        pytest.param("lift", 1e-4, {"controller": "foc"}, marks=pytest.mark.slow),
        pytest.param("tilt", 1e-4, {"controller": "cac"}, marks=pytest.mark.slow),
        pytest.param("telescope", 1e-4, {"controller": "anatc"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_double_gives_the_bits_of_the_fmus(
    joint: str, step: float, options: dict[str, Any], fmu_folder: Path, tmp_path: Path
) -> None:
    source = tmp_path / "control.c"
    ec.load(joint, fmus=fmu_folder, **options).export(source, components=CONTROL)
    code = Code(source)
    assert float(re.search(r"_STEP (\S+)", source.with_suffix(".h").read_text())[1]) == step  # type: ignore[index]
    rows = drive(code, Chain(joint, fmu_folder, tmp_path, **options), joint, 400, step)
    assert np.ptp(rows[:, 0], axis=0).min() > 0.0
    assert rows[:, 0].tobytes() == rows[:, 1].tobytes()
    assert code.start(0.25) is None  # a second start forgets the first run
    again = [getattr(code.outputs, field) for field, _ in type(code.outputs)._fields_]
    code.step()
    assert np.isfinite(again).all()


def pid(gain: float) -> type[Block]:
    """A block class; all have one name."""

    class Pid(Block):
        """A controller with both kinds of states, a Boolean, a whole number and an array."""

        r = Input()
        y = Input()
        auto = Input(True)
        k = Parameter([3.0, 1.0], shape=2, name="gain.k", minimum=0.0)
        s_0 = Parameter(0.5)
        n = Parameter(2)
        i = DiscreteState(0.0)
        s = State(s_0)
        u = Output()
        count = Output(0)

        def derivatives(self, v: Any) -> dict[str, Any]:
            return {"s": v.r - v.y - 0.1 * v.s}

        def update(self, v: Any) -> dict[str, Any]:
            return {"i": where(v.auto, v.i + gain * sin(v.time) + 0.01 * (v.r - v.y), v.i)}

        def outputs(self, v: Any) -> dict[str, Any]:
            return {"u": v.k[0] * v.i + v.k[1] * v.s, "count": where(v.s > 0.6, v.n, 0)}

    return Pid


def test_own_blocks_give_the_bits_of_a_run(tmp_path: Path) -> None:
    """Two components of one block, and one of another block with the same name."""
    first, second = pid(0.1), pid(0.2)
    components = [
        ec.Component("a", model=first),
        ec.Component("b", model=first, parameters={"gain.k[2]": 0.25, "s_0": 0.75, "n": 7}),
        ec.Component("a_b", model=second),
    ]
    links = [
        ec.Connection("a", "u", "b", "r"),
        ec.Connection("b", "u", "a_b", "y"),
        ec.Connection("a_b", "u", "a", "y"),
    ]
    for algorithm in ("gauss-seidel", "jacobi"):
        scenario = ec.load(
            ec.System(components, links),
            step_size=0.01,
            stop_time=1.0,
            algorithm=algorithm,
            set={"a.r": 1.5, "a_b.auto": False},
        )
        source = tmp_path / f"{algorithm.partition('-')[0]}.c"
        scenario.export(source, components=["*"], outputs=["*"])
        code, run = Code(source), scenario.prepare().run()
        assert code.start() is None
        fields = {signal: code.field(signal) for signal in ("a.u", "b.u", "a_b.u", "b.count", "a_b.count")}
        for k in range(101):
            for signal, field in fields.items():
                assert getattr(code.outputs, field) == run[signal][k], (algorithm, signal, k)
            assert code.step()
        assert (run["b.count"] == 7).all() and all(
            np.ptp(run[f"{name}.u"]) > 0.0 for name in ("a", "b", "a_b")
        )


@pytest.mark.parametrize(
    "names",
    [("parameters", "signals"), ("a", "a_fixed"), ("a.b", "a_b"), ("count", "start_time"), ("int", "_")],
)
def test_components_may_have_any_names(names: tuple[str, str], tmp_path: Path) -> None:
    block = pid(0.1)
    system = ec.System(
        [ec.Component(name, model=block) for name in names], [ec.Connection(names[0], "u", names[1], "r")]
    )
    source = tmp_path / "real.c"
    ec.load(system, step_size=0.01, stop_time=1.0).export(source, components=["*"])
    code = Code(source)
    assert code.start() is None and code.step()
    whole = next(field for field, name in code.names.items() if name == f"{names[1]}.n")
    setattr(code.parameters, whole, 2.5)
    wrong = code.start()
    assert wrong is not None and wrong.startswith(f"{names[1]}.n ") and "no whole number" in wrong


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("x.ssp", {"components": ["controller"]}, "an SSP cannot hold --components"),
        ("x.ssp", {"inputs": ["*"]}, "an SSP cannot hold --inputs"),
        ("x.fmu", {"precision": "float"}, "an FMU cannot hold --precision"),
        ("x.c", {"components": CONTROL, "platform": ["win64"]}, "a C file cannot hold --platform"),
    ],
)
def test_python_refuses_options_that_a_file_cannot_hold(
    name: str, options: dict[str, Any], words: str, fmu_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(CommandError, match=words):
        ec.load("lift", fmus=fmu_folder).export(tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_float_is_near_double(fmu_folder: Path, tmp_path: Path) -> None:
    rows = {}
    for precision in ("double", "float"):
        source = tmp_path / f"control_{precision}.c"
        ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL, precision=precision)
        chain = Chain("lift", fmu_folder, tmp_path / precision)
        rows[precision] = drive(Code(source), chain, "lift", 1000, 1e-4)[:, 0]
    spread = np.ptp(rows["double"], axis=0)
    error = np.abs(rows["float"] - rows["double"]).max(axis=0) / spread
    print("float differs by", error, "of the ranges")
    assert (error < 1e-2).all() and (error > 0.0).any()


def test_a_wrong_parameter_is_named(fmu_folder: Path, tmp_path: Path) -> None:
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


def test_parameters_have_effect(fmu_folder: Path, tmp_path: Path) -> None:
    """A parameter that is set in C gives what the same one gives in the scenario."""
    results = []
    for place, options in ((1, {}), (2, {"set": {"lift.controller.beta[2]": 123.0}})):
        source = tmp_path / f"control{place}.c"
        ec.load("lift", fmus=fmu_folder, **options).export(source, components=CONTROL)
        code = Code(source)
        setattr(code.parameters, code.field("lift.controller.beta[2]"), 123.0)
        setattr(code.inputs, code.field("lift.controller.x_d"), 0.2)
        assert code.start() is None
        for _ in range(20):
            assert code.step()
        results.append([getattr(code.outputs, field) for field, _ in type(code.outputs)._fields_])
    assert results[0] == results[1] and any(results[0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "plain C needs --components, such as --components controller; there are lift."),
        ({"components": ["gone"]}, "no component matches 'gone' of --components; there are lift."),
        ({"components": ["disturbance"], "precision": "float"}, "float has them only up to 16777216"),
        (
            {"components": CONTROL, "outputs": ["lift.plant.x_L"]},
            "no output matches 'lift.plant.x_L'; there are",
        ),
        ({"components": CONTROL, "algorithm": "strong"}, "plain C has no strong coupling; add --algorithm"),
        ({"components": CONTROL, "extrapolation": "fmu"}, "plain C does not extrapolate inputs; add"),
        ({"components": CONTROL, "step_multiples": {"lift.observer": 2}}, "have different step multiples: "),
        ({"components": CONTROL, "precision": "half"}, "precision"),
    ],
    ids=lambda x: " ".join(map(str, x.values())) if isinstance(x, dict) else "",
)
def test_what_cannot_be_plain_c_is_refused(
    options: dict[str, Any], words: str, fmu_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(CommandError) as refused:
        ec.load("lift", fmus=fmu_folder).export(tmp_path / "control.c", **options)
    assert words in str(refused.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["my control.c", "1st.c", "int.c", "a-b.c"])
def test_a_name_that_is_none_in_c_is_refused(name: str, fmu_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="begins all names in C"):
        ec.load("lift", fmus=fmu_folder).export(tmp_path / name, components=CONTROL)


def test_an_fmu_file_cannot_be_plain_c(fmu_folder: Path, tmp_path: Path) -> None:
    fmu = shutil.copy(fmu_folder / "EmlaObserver/EmlaObserver.fmu", tmp_path / "mine.fmu")
    with pytest.raises(CommandError, match="is an FMU file; only blocks of Python can be plain C"):
        ec.load(str(fmu)).export(tmp_path / "out.c", components=["*"])


@pytest.fixture
def emla(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.chdir(tmp_path)
    return lambda *options: CliRunner().invoke(app, ["export", "lift", *options, "--fmus", str(fmu_folder)])


def test_the_command_writes_both_files_and_replaces_only_its_own(
    emla: Callable[..., Result], tmp_path: Path
) -> None:
    asked = ("control.c", "--components", "controller", "--outputs", "lift.controller.*")
    done = emla(*asked)
    assert done.exit_code == 0 and "control.c" in done.output and "control.h" in done.output
    first = (tmp_path / "control.c").read_bytes(), (tmp_path / "control.h").read_bytes()
    assert b"lift.controller.saturated" in first[1] and emla(*asked).exit_code == 0
    assert first == ((tmp_path / "control.c").read_bytes(), (tmp_path / "control.h").read_bytes())
    (tmp_path / "control.h").write_text("mine")
    refused = emla(*asked)
    assert refused.exit_code == 2 and "'control.h'" in refused.stderr
    assert (tmp_path / "control.h").read_text() == "mine"
    assert (tmp_path / "control.c").read_bytes() == first[0]
    assert emla(*asked, "--overwrite").exit_code == 0
    assert (tmp_path / "control.h").read_bytes() == first[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("x.ssp", "--components", "controller"), "an SSP cannot hold --components"),
        (("x.fmu", "--precision", "float"), "an FMU cannot hold --precision"),
        (("x.c", "--inputs", "*"), "a C file cannot hold --inputs"),
        (("x.c", "--platform", "win64"), "a C file cannot hold --platform"),
    ],
)
def test_options_of_other_files_are_refused(
    options: tuple[str, ...], words: str, emla: Callable[..., Result]
) -> None:
    refused = emla(*options)
    assert refused.exit_code == 2 and words in refused.stderr


def test_the_code_needs_nothing_but_mathematics(fmu_folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "control.c"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL)
    included = re.findall(r"#include (\S+)", source.read_text() + source.with_suffix(".h").read_text())
    assert included == ["<stddef.h>", "<tgmath.h>", '"control.h"']
    assert not re.search(r"\b(static (?!const|void|int|inline)|malloc|printf)", source.read_text())


@pytest.mark.slow
def test_a_program_in_cpp_can_call_it(fmu_folder: Path, tmp_path: Path) -> None:
    source, main = tmp_path / "control.c", tmp_path / "main.cpp"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL)
    main.write_text(
        '#include "control.h"\nint main() {\n    control_parameters p;\n    control_inputs u;\n'
        "    control_defaults(&p, &u);\n    return p.controller_beta_1 > 0.0 ? 0 : 1;\n}\n"
    )
    parts = [("cc", source, "-std=c99"), ("c++", main, "-std=c++11")]
    for kind, file, standard in parts:
        command = [
            *COMPILER[:3],
            kind,
            standard,
            "-Wall",
            "-Werror",
            "-c",
            file,
            "-o",
            file.with_suffix(".o"),
        ]
        assert subprocess.run(command, check=False).returncode == 0
    objects = [file.with_suffix(".o") for _, file, _ in parts]
    command = [*COMPILER[:3], "cc", *objects, "-lm", "-o", tmp_path / "program"]  # it needs no C++ library
    assert subprocess.run(command, check=False).returncode == 0
    assert subprocess.run([tmp_path / "program"], check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
def test_it_links_for_a_cortex_m4(precision: str, fmu_folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "control.c"
    ec.load("lift", fmus=fmu_folder).export(source, components=CONTROL, precision=precision)
    (tmp_path / "main.c").write_text(
        '#include "control.h"\n'
        "static control memory;\nstatic control_parameters parameters;\n"
        "volatile control_inputs given;\nvolatile control_outputs taken;\n"
        "int main(void) {\n    control_inputs u;\n    control_outputs y;\n"
        "    control_defaults(&parameters, &u);\n"
        "    if (control_start(&memory, 0, &parameters, &u, &y)) return 1;\n"
        "    for (;;) {\n        u = given;\n        if (!control_step(&memory, &u, &y)) return 2;\n"
        "        taken = y;\n    }\n}\n"
    )
    target = ["-target", "thumb-linux-musleabihf", "-mcpu=cortex_m4", "-Os", "-static", "-s"]
    files = [str(source), str(tmp_path / "main.c"), "-o", str(tmp_path / "control.elf")]
    done = subprocess.run([*COMPILER, *target, *files], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    size = (tmp_path / "control.elf").stat().st_size
    print(f"{precision}: {size} bytes")
    assert size < 200_000


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
def test_it_controls_the_plant_as_in_a_run(precision: str, fmu_folder: Path, tmp_path: Path) -> None:
    """The other FMUs of the lift in FMPy, with the C code in place of observer and controller."""
    source, steps = tmp_path / "control.c", 5000
    scenario = ec.load("lift", fmus=fmu_folder, stop_time=steps * 1e-4, output_interval=1e-4)
    scenario.export(source, components=CONTROL, precision=precision)
    run = scenario.prepare().run()
    code = Code(source)
    own = {f"lift.{name}" for name in CONTROL}
    loop = Chain("lift", fmu_folder, tmp_path / "fmus", parts=("reference", "disturbance", "plant"))
    driven = [(a, x, b, y) for (a, x), (b, y) in loop.connections if b in own and a not in own]
    driving = [(a, x, b, y) for (a, x), (b, y) in loop.connections if a in own and b not in own]

    def to_code() -> None:
        for a, x, b, y in driven:
            setattr(code.inputs, code.field(f"{b}.{y}"), loop.get(f"{a}.{x}"))

    def from_code() -> None:
        for a, x, b, y in driving:
            loop.set(f"{b}.{y}", getattr(code.outputs, code.field(f"{a}.{x}")))

    loop.start()
    to_code()
    assert code.start() is None
    order = [c for c in run.stepping["order"] if c not in own or c == "lift.observer"]
    error = []
    for k in range(steps):
        for name in order:
            if name == "lift.observer":
                to_code()
                assert code.step()
            else:
                from_code()
                loop.pass_values(name)
                loop.parts[name][0].doStep(k * 1e-4, 1e-4)
        error.append([loop.get("lift.plant.x_L"), loop.get("lift.reference.x_d")])
    loop.close()
    found = np.array(error)
    late = run.time[1:] > 0.3
    print(precision, np.abs(found[late, 0] - found[late, 1]).max(), "m")
    if precision == "double":
        assert found[:, 0].tobytes() == run["lift.plant.x_L"][1:].tobytes()
    else:
        assert np.abs(found[:, 0] - run["lift.plant.x_L"][1:]).max() < 1e-5

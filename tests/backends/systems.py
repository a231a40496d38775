"""The systems of the matrix, one entry each: small, and each with something that the others lack.

A new system is one more entry of `SYSTEMS`. Steppers and algorithms that cannot step it are named by what
it `has`: a stepper, an algorithm or another system says in its `lacks` what it cannot do.
"""

import dataclasses
import itertools
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import emla_cosim as ec
from emla_cosim.fmu.models import MODELS, build, fmu_path
from fmublock import Block, DiscreteState, Input, Output, Parameter, State, cos, where
from fmublock.cache import VARIABLE
from tests.support.faulty_systems import faulty, line_with_a_fault, loop_with_a_fault, wired
from tests.support.hand_written_fmus import (
    Fault,
    build_all_types_3_fmu,
    build_all_types_fmu,
    build_event_fmu,
    build_faulty_fmu,
    build_integrated_fmu,
    build_trigger_fmu,
    edit_description,
)

# ---- blocks --------------------------------------------------------------------------------------


class Mass(Block):
    """A mass on a spring with a damper."""

    F = Input()
    k = Parameter(400.0)
    x = State(0.1)
    w = State(0.0)
    a = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.w, "w": v.F - v.k * v.x - 2.0 * v.w}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"a": v.F - v.k * v.x - 2.0 * v.w}


class Load(Block):
    """A mass that is fixed to another one."""

    a = Input()
    m = Parameter(1.5)
    F = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": -v.m * v.a}


class Hanging(Block):
    """A mass that hangs on another one, on a spring with a damper."""

    x_0 = Input()
    w_0 = Input()
    x = State(0.0)
    w = State(0.0)
    F = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.w, "w": 200.0 * (v.x_0 - v.x) + 8.0 * (v.w_0 - v.w)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"F": 100.0 * (v.x - v.x_0) + 4.0 * (v.w - v.w_0)}


class Mixer(Block):
    """Two lags with direct feedthrough."""

    u = Input()
    w = Input()
    D = Parameter(0.0, shape=4)
    x = State(1.0)
    y = Output()
    z = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.u + v.w - 2.0 * v.x}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.x + v.D[0] * v.u + v.D[1] * v.w, "z": v.x + v.D[2] * v.u + v.D[3] * v.w}


class Curve(Block):
    """A curve without states, which moves with the time."""

    u = Input()
    p = Parameter(3.0)
    q = Parameter(1.0)
    phase = Parameter(0.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.p * cos(v.u + v.phase) + v.q * v.time}


class Mirror(Block):
    """Its input, with a gain until 0.25 s, and raised then."""

    u = Input()
    gain = Parameter(1.0)
    rise = Parameter(0.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": where(v.time > 0.26, v.u + v.rise, 1.0 + v.gain * v.u)}


class Pid(Block):
    """A controller with both kinds of states, a Boolean, an integer and an array."""

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
        return {"i": where(v.auto, v.i + 0.1 * cos(v.time) + 0.01 * (v.r - v.y), v.i)}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u": v.k[0] * v.i + v.k[1] * v.s, "count": where(v.s > 0.6, v.n, 0)}


class Springs(Block):
    """Two masses on springs, each with a force."""

    F = Input([0.25, -0.5], shape=2)
    x = State([0.1, -0.2], shape=2)
    w = State([0.0, 0.3], shape=2)
    y = Output(shape=3)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {
            "x": [v.w[0], v.w[1]],
            "w": [v.F[0] - 4.0 * v.x[0] - 0.1 * v.w[0], v.F[1] - 9.0 * v.x[1] - 0.2 * v.w[1]],
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": [v.x[0], v.x[1] + 0.5 * v.F[1], v.x[0] - v.w[1]]}


# ---- FMUs ----------------------------------------------------------------------------------------

BLOCKS = Path(os.environ[VARIABLE]) / "fmus of the matrix"
"""Where the FMUs of blocks are, by version of FMI, for all processes and the next run."""


@cache
def _build_block(block: type[Block], fmi: int) -> Path:
    return build(block, "native", [], BLOCKS / str(fmi), fmi=fmi)


class Parts:
    """Builds the FMUs of systems, each once.

    Args:
        folder: Where those are built that are written by hand.
        fmus: Folder with the FMUs of the project.
        kind: FMI 2 or 3 for the FMUs that exist for both versions, `mixed`, or `blocks` for no files.
    """

    def __init__(self, folder: Path, fmus: Path, kind: int | str = 2) -> None:
        self.folder, self.fmus, self.kind = folder, fmus, kind
        self._versions = itertools.cycle([2, 3])

    def version(self) -> int:
        """Return the version of the next FMU; `mixed` alternates."""
        return next(self._versions) if self.kind == "mixed" else 3 if self.kind == 3 else 2

    def build(self, name: str, make: Callable[[Path], Any]) -> Path:
        """Return the path of an FMU, which is built unless it exists."""
        path = self.folder / f"{name}.fmu"
        if not path.exists():
            path.parent.mkdir(exist_ok=True, parents=True)
            make(path)
        return path

    def block(self, block: type[Block], fmi: int | None = None) -> Path | type[Block]:
        """Return the FMU of a block, of one version if that matters."""
        if self.kind == "blocks":
            return block
        fmi = fmi or self.version()
        if fmi == 2 and block in MODELS.values():
            return fmu_path(block.__name__, "native", self.fmus)
        return _build_block(block, fmi)

    def faulty(self) -> Path:
        return self.build("Faulty", lambda path: build_faulty_fmu(path.parent))

    def plain(self) -> Path:
        """Return the faulty FMU without derivatives of inputs."""
        return self.build(
            "Plain", lambda path: build_faulty_fmu(path.parent, interpolate=False, name="Plain")
        )

    def all_types(self) -> Path:
        return self.build("AllTypes", build_all_types_fmu)

    def integer_input(self) -> Path:
        """Return the FMU with all types of FMI 2.0, one of whose parameters is an input."""
        was, becomes = "parameter", "input"
        edits = (f'name="first" valueReference="0" causality="{x}" variability=' for x in (was, becomes))
        old, new = (f'{text}"{v}"' for text, v in zip(edits, ("fixed", "discrete"), strict=True))
        return self.build(
            "IntegerInput",
            lambda path: edit_description(self.all_types(), path, f'{old} initial="exact"', new),
        )

    def types_of_fmi_3(self) -> Path:
        return self.build("Third", build_all_types_3_fmu)

    def events(self, clock: str | None = None) -> Path:
        return self.build(f"Events{clock or ''}", lambda path: build_event_fmu(path, clock=clock))

    def triggers(self) -> Path:
        return self.build("Triggers", build_trigger_fmu)

    def integrated(self) -> Path:
        """Return a Model Exchange FMU: x' = u - x, y = x + gain u, a bouncing ball and a stair."""
        fmi = self.version()
        return self.build(f"{fmi}/Integrated", lambda path: build_integrated_fmu(path, version=fmi))

    def replacements(self, scenario: str) -> dict[str, Any]:
        """Return FMUs for all components of a scenario that are of the project's models."""
        if self.kind not in (3, "mixed"):
            return {}
        components = ec.load(scenario, fmus=self.fmus).system.components
        return {c.name: self.block(MODELS[str(c.model)]) for c in components if c.model in MODELS}


# ---- systems -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Entry:
    """A system of the matrix.

    Attributes:
        build: Returns a system, or the name of a scenario.
        options: Options of all its runs.
        step: Communication step in s.
        steps: Steps of a run; a multiple of 6.
        has: What a stepper or algorithm must be able to do.
        lacks: What the system cannot be combined with.
        fails: A part of the error message that ends its runs; empty if they succeed.
    """

    build: Callable[[Parts], ec.System | str]
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    step: float = 1.0 / 32.0
    steps: int = 24
    has: Collection[str] = ()
    lacks: Collection[str] = ()
    fails: str = ""


def rigid_load(parts: Parts) -> ec.System:
    components = {"mass": parts.block(Mass), "load": parts.block(Load)}
    return ec.System.of(components, ["mass.a -> load.a", "load.F -> mass.F"])


def elastic_load(parts: Parts) -> ec.System:
    components = {"mass": parts.block(Mass), "load": parts.block(Hanging)}
    wires = ["mass.x -> load.x_0", "mass.w -> load.w_0", "load.F -> mass.F"]
    return ec.System.of(components, wires)


def two_loops(parts: Parts) -> ec.System:
    """One of two signals, and one that reads the first; with a component before and one behind."""
    values = {
        "a.D": [1.5, -0.4, 0.3, 0.25],
        "b.D": [0.2, 0.1, -0.1, 0.3],
        "c.D": [1.0, -2.5, 0.0, 0.0],
        "d.D": [1.0, 0.0, 0.0, 0.0],
    }
    wires = ["b.y -> a.u", "b.z -> a.w", "a.y -> b.u", "a.z -> b.w"]
    wires += ["d.y -> sink.u", "source.y -> c.u", "d.y -> c.w", "c.y -> d.u"]
    return ec.System.of(dict.fromkeys(["sink", *"ab", "source", *"cd"], parts.block(Mixer)), wires, values)


def curves(parts: Parts) -> ec.System:
    """x = 3 cos(y) + t, y = 2 sin(x): needs many sweeps in each step."""
    values = {"b.p": 2.0, "b.q": 0.0, "b.phase": -1.5}
    return ec.System.of(dict.fromkeys("ab", parts.block(Curve)), ["b.y -> a.u", "a.y -> b.u"], values)


def controllers(parts: Parts) -> ec.System:
    """A ring of three blocks with discrete and continuous states, and open inputs."""
    values = {"b.gain.k[2]": 0.25, "b.s_0": 0.75, "b.n": 7, "a.r": 1.5, "a_b.auto": False}
    components = dict.fromkeys(["a", "b", "a_b"], parts.block(Pid))
    return ec.System.of(components, ["a.u -> b.r", "b.u -> a_b.y", "a_b.u -> a.y"], values)


def transformed(parts: Parts) -> ec.System:
    """Connections with factors and offsets."""
    system = elastic_load(parts)
    factors = [(2.0, 0.01), (-0.5, 0.0), (0.25, -3.0)]
    wires = [
        dataclasses.replace(c, transformation=ec.LinearTransformation(*f))
        for c, f in zip(system.connections, factors, strict=True)
    ]
    return dataclasses.replace(system, connections=tuple(wires))


def arrays(parts: Parts) -> ec.System:
    """Elements of arrays of FMI 3.0, connected by element; others are open."""
    components = dict.fromkeys("ab", parts.block(Springs, 3))
    return ec.System.of(components, ["a.y[1] -> b.F[2]", "b.y[2] -> a.F[1]"], {"a.x[2]": 0.7})


def discarding(parts: Parts) -> ec.System:
    """A loop and a component behind it; two of the four discard long steps."""
    fmu, plain = parts.faulty(), parts.plain()
    components = [
        faulty("j.a", fmu, a=-1.0, b=-0.5, longest=0.02),
        faulty("j.b", plain, b=0.25),
        faulty("j.c", fmu, u=1.0, b=0.5, a=-2.0),
        faulty("j.d", plain, longest=0.01),
    ]
    return wired(components, "j.b.y -> j.a.u", "j.a.y -> j.b.u", "j.a.z -> j.d.u")


def fmi_3_types(parts: Parts) -> ec.System:
    """A component that counts drives inputs of all types of another; arrays pass whole and in parts."""
    kinds = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32")
    wires = [f"a.Int64_out -> b.{kind}_in" for kind in kinds]
    wires += ["b.y -> c.u", "a.x -> b.u[2,1]", "a.Int64_out -> b.u[1,2]", "a.Boolean_out -> b.Boolean_in"]
    wires += ["a.Enumeration_out -> b.Enumeration_in", "b.Boolean_out -> c.UInt8_in"]
    values = {"a.stride": 5, "a.u[1,1]": 0.8, "a.Enumeration_in": "two", "c.gain[1,2]": -0.3}
    third = parts.types_of_fmi_3()
    return ec.System.of(dict.fromkeys("abc", third), wires, values | {"a.Boolean_in": True})


def fmi_2_types(parts: Parts) -> ec.System:
    fmu = parts.all_types()
    return ec.System.of({"a": fmu, "b": fmu}, ["a.high -> b.on", "a.count -> b.u"], {"a.u": 2.0})


def events(parts: Parts) -> ec.System:
    """Time events, state events, and a discrete input that changes at events of the other."""
    values = {"a.period": 0.21, "a.threshold": 0.17}
    return ec.System.of(dict.fromkeys("ab", parts.events()), ["a.count -> b.n"], values)


def clocks(parts: Parts) -> ec.System:
    """A clock with a period, and one that ticks some time after each event."""
    values = {"a.w": 2.0, "b.threshold": 0.35}
    fmus = {name: parts.events(clock) for name, clock in (("a", "periodic"), ("b", "countdown"))}
    return ec.System.of(fmus, ["a.x -> b.w"], values)


def triggered_clocks(parts: Parts) -> ec.System:
    wires = ["a.alarm -> b.go", "a.level -> b.w"]
    return ec.System.of(dict.fromkeys("ab", parts.triggers()), wires, {"a.period": 0.3, "a.burst": 2})


def model_exchange(parts: Parts) -> ec.System:
    """a' = -a - b, b' = a - b, each also with its own ball and stair; a step event sets b back at 0.25."""
    system = ec.System.of(
        {"a": parts.integrated(), "b": parts.integrated()},
        ["a.x -> b.u", "b.x -> a.u"],
        {"b.x": 0.0, "b.limit": 0.25},
    )
    first, second = system.connections
    second = dataclasses.replace(second, transformation=ec.LinearTransformation(-1.0))
    return dataclasses.replace(system, connections=(first, second))


def integrated_arrays(parts: Parts) -> ec.System:
    """An element of a.F comes from b, which is integrated with a, and the other one from c, which is not."""
    wires = ["a.y[2] -> b.F[2]", "b.y[2] -> a.F[2]", "c.y[3] -> a.F[1]", "a.y[1] -> c.F[2]"]
    return ec.System.of(dict.fromkeys("abc", parts.block(Springs)), wires, {"a.x[2]": 0.7})


def driven_lift(parts: Parts) -> ec.System:
    data = parts.folder / "load.csv"
    data.write_text("time,lift.plant.F_L\n0,1000\n0.001,5000\n0.003,2000\n")
    return "lift"


def data(parts: Parts) -> ec.System:
    """Lines and levels drive a loop and an FMU that does not interpolate; a jump is between two points."""
    lines, levels = (parts.folder / name for name in ("lines.csv", "levels.csv"))
    lines.write_text("time;a.w;c.u[2,1]\n0;1;0.2\n0.1;2;0.5\n0.26;2.5;0.4\n0.26;-1;0.9\n0.4;0;1\n")
    levels.write_text("time,b.w,c.UInt8_in\n0,0.5,3\n0.125,1,7\n0.3,-1,2\n")
    components = {**dict.fromkeys("ab", parts.block(Mixer)), "c": parts.types_of_fmi_3()}
    values = {"a.D": [0.1, 0.5, 0.0, 0.2], "b.D": [0.2, 0.3, 0.1, 0.4], "c.gain[1,2]": -0.3}
    return ec.System.of(components, ["a.y -> b.u", "b.z -> a.u", "a.z -> c.u[1,1]"], values)


LIFT: dict[str, Any] = {"step": 1e-4, "steps": 30}
SAMPLED = {"lift.controller": 5, "lift.observer": 2}
ME = {"has": {"Model Exchange"}, "step": 0.05}
TICKS: dict[str, Any] = {"step": 0.125, "has": {"events"}, "lacks": {"error control"}}

SYSTEMS: dict[str, Entry] = {
    "rigid load": Entry(rigid_load, has={"blocks", "direct loop"}, lacks={"explicit error control"}),
    "elastic load": Entry(elastic_load, has={"blocks"}),
    "two loops": Entry(two_loops, has={"blocks", "direct loop"}, lacks={"explicit error control"}),
    "nonlinear loop": Entry(curves, has={"blocks", "direct loop"}, lacks={"error control"}),
    "discrete states": Entry(controllers, has={"blocks"}, lacks={"error control"}),
    "factors, early start": Entry(  # a step across zero does not join the points to the last bit
        transformed, {"start_time": -0.05}, step=1.0 / 224.0, has={"blocks", "transformations"}
    ),
    "arrays of FMI 3.0": Entry(arrays, has={"arrays"}),
    "multirate": Entry(
        two_loops,
        {"step_multiples": {"sink": 3, "d": 2}},
        has={"blocks", "multirate"},
        lacks={"error control"},
    ),
    "discarded steps": Entry(discarding, has={"discarded steps"}),
    "types of FMI 3.0": Entry(fmi_3_types, step=0.125, has={"types of FMI 3.0"}, lacks={"error control"}),
    "types of FMI 2.0": Entry(
        fmi_2_types,
        step=0.01,
        has={"libraries", "types of FMI 2.0"},
        lacks={"error control"},  # the shortest step, which its jumps take, depends on the stop time
    ),
    "events": Entry(events, step=0.125, has={"events"}),
    "clocks": Entry(clocks, **TICKS),
    "triggered clocks": Entry(triggered_clocks, **TICKS),
    "data": Entry(
        data,
        {"input": ["lines.csv", "levels.csv:interpolation=held"]},
        step=0.0625,
        has={"blocks", "data", "types of FMI 3.0"},
        lacks={"error control"},
    ),
    "Model Exchange": Entry(model_exchange, **ME, options={"integrate_together": False}),
    "integrated together": Entry(
        model_exchange, **{**ME, "has": {"Model Exchange", "grouped"}}, lacks={"error control"}
    ),
    "arrays, integrated together": Entry(
        integrated_arrays,
        {"kind": {"a": "me", "b": "me"}},
        **{**ME, "has": {"Model Exchange", "grouped"}},
        steps=12,
        lacks={"error control"},
    ),
    "lift": Entry(lambda parts: "lift", **LIFT, has={"scenario"}),
    "lift, sampled": Entry(
        lambda parts: "lift",
        {"step_multiples": SAMPLED},
        **LIFT,
        has={"scenario", "multirate"},
        lacks={"error control"},
    ),
    "lift with data and a fault": Entry(
        driven_lift,
        {"input": ["load.csv"], "fault": ["lift.plant.x_measured=offset:1e-5@0.001+0.001"]},
        **LIFT,
        has={"scenario", "data"},
        lacks={"error control"},
    ),
    "machine": Entry(
        lambda parts: "hdrm-coupled",
        **LIFT,
        has={"scenario", "slow", "array loop"},
        lacks={"explicit", "error control"},
    ),
}

# ---- systems that fail ---------------------------------------------------------------------------

AT = 0.35
MESSAGES = {
    Fault.DISCARD: "with fmi2Discard",
    Fault.ERROR: "with fmi2Error",
    Fault.FATAL: "with fmi2Fatal",
    Fault.NAN_Y: "NaN",
    Fault.TERMINATE: "asked to end the simulation during doStep",
    Fault.GET_REAL: "answered getReal",
    Fault.SET_REAL: "answered setReal",
    Fault.PENDING: "with fmi2Pending",
    Fault.NEGATIVE: "with status -1",
    Fault.GET_STATE: "answered getFMUstate",
    Fault.SET_STATE: "answered setFMUstate",
    Fault.SET_DERIVATIVE: "answered setRealInputDerivatives",
}


def unsolvable(parts: Parts) -> ec.System:
    """x = y, y = x + 1 from 0.25 s on."""
    components = {"a": parts.block(Mirror), "b": parts.block(Mirror)}
    return ec.System.of(components, ["b.y -> a.u", "a.y -> b.u"], {"a.rise": 1.0, "a.gain": -0.5})


REPEATED, WITH_LINES = {"explicit"}, {"held inputs"}
LACKS = {Fault.GET_STATE: REPEATED, Fault.SET_STATE: REPEATED, Fault.SET_DERIVATIVE: WITH_LINES}
"""Algorithms that do not call the function that fails."""


def moving_loop_with_a_fault(fmu: Path, fault: Fault, at: float) -> ec.System:
    """A loop that an offset sets in motion, so that strong coupling has to repeat steps."""
    system = loop_with_a_fault(fmu, fault, at)
    first, *remaining = system.connections
    first = dataclasses.replace(first, transformation=ec.LinearTransformation(1.0, 1.0))
    return dataclasses.replace(system, connections=(first, *remaining))


def fails(fault: Fault, is_loop: bool) -> Entry:
    make = moving_loop_with_a_fault if is_loop else line_with_a_fault
    return Entry(
        lambda parts: make(parts.faulty(), fault, AT),
        step=0.1,
        steps=12,
        has={"failure"} | ({"fatal"} if fault is Fault.FATAL else set()),
        lacks=LACKS.get(fault, ()),
        fails=MESSAGES[fault],
    )


def large_integers(parts: Parts) -> ec.System:
    """A component of FMI 3.0 that counts drives an Integer of FMI 2.0."""
    third, second = parts.types_of_fmi_3(), parts.integer_input()
    return ec.System.of({"a": third, "b": second}, ["a.Int64_out -> b.first"], {"a.stride": 900_000_000})


def fails_in_fmi_3(message: str, values: Mapping[str, Any], *wires: str, is_loop: bool = False) -> Entry:
    links = ["a.y -> b.u", *wires, *(["b.y[1,1] -> a.u[1,1]"] if is_loop else [])]
    return Entry(
        lambda parts: ec.System.of(
            dict.fromkeys("ab", parts.types_of_fmi_3()), links, {"a.gain[1,1]": -0.25, **values}
        ),
        step=0.125,
        has={"failure", "types of FMI 3.0"},
        fails=message,
    )


IN_A_LOOP = (
    *(Fault.DISCARD, Fault.NAN_Y, Fault.TERMINATE, Fault.GET_REAL, Fault.NEGATIVE),
    *(Fault.GET_STATE, Fault.SET_STATE),
)
IN_A_LINE = (
    *(Fault.DISCARD, Fault.ERROR, Fault.FATAL, Fault.NAN_Y, Fault.SET_REAL, Fault.PENDING),
    *(Fault.TERMINATE, Fault.SET_DERIVATIVE),
)

FAILING: dict[str, Entry] = {
    **{f"{fault.name} in a line": fails(fault, False) for fault in IN_A_LINE},
    **{f"{fault.name} in a loop": fails(fault, True) for fault in IN_A_LOOP},
    "unsolvable loop": Entry(
        unsolvable,
        steps=12,
        has={"failure"},
        lacks={"explicit", "error control", "extrapolation"},
        fails="does not converge on the step from t = 0.259979248 s of 3.05e-05 s",
    ),
    "FMI 3.0: discards": fails_in_fmi_3("with fmi3Discard", {"b.fault": 1, "b.end": 0.5}),
    "FMI 3.0: terminates": fails_in_fmi_3(
        "asked to end the simulation during doStep",
        {"b.fault": 2, "b.end": 0.5},
        "a.Int32_out -> b.Int16_in",
        is_loop=True,
    ),
    "FMI 3.0: returns early": fails_in_fmi_3(
        ", which was not allowed", {"b.fault": 3, "b.end": 0.5}, "a.Int32_out -> b.Int16_in"
    ),
    "FMI 3.0: wants event mode": fails_in_fmi_3(
        "asked for event mode, which is not used", {"b.fault": 4, "b.end": 0.5}, is_loop=True
    ),
    "too large for Int8": fails_in_fmi_3(
        "its input Int8_in is Int8 and cannot be 180", {"a.stride": 60}, "a.Int64_out -> b.Int8_in"
    ),
    "too small for UInt8": fails_in_fmi_3(
        "its input UInt8_in is UInt8 and cannot be -1",
        {"a.stride": -1},
        "a.Int64_out -> b.UInt8_in",
        is_loop=True,
    ),
    "too large for Integer": Entry(
        large_integers,
        step=0.125,
        has={"failure", "types of FMI 2.0", "types of FMI 3.0"},
        fails="its input first is Integer and cannot be 2700000000",
    ),
    "infinite": fails_in_fmi_3("a.x ", {"a.u[1,1]": 1.7e308}, "a.x -> b.Float32_in"),
}

"""Commands and surroundings, good and bad, for hypothesis to draw.

Options come from the table of options: one that is new is drawn too, with values of its type.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_origin

from hypothesis import strategies as st

from emla_cosim.base.option import EXPORT, INFO, RUN, Option
from emla_cosim.fmu.models import MODELS
from emla_cosim.run.options import list_options
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from fmublock.platforms import host_platform
from tests.support.odd_files import FILES, ODD, Materials

USABLE, CLOSED, FULL = "usable", "closed", "full"
"""What streams can be: read by us, closed, on a full disk."""

FMUS, FOLDER = "{fmus}", "{folder}"
"""Placeholders of the folder of FMUs and that of a command, which are others every time."""


def _weighted(*parts: tuple[int, st.SearchStrategy[Any]]) -> st.SearchStrategy[Any]:
    """One of some strategies, the first as often as its number says, and so on."""
    return st.sampled_from([s for weight, s in parts for _ in range(weight)]).flatmap(lambda s: s)


# ---- values of options -----------------------------------------------------------------------------

_NO_FILES = [
    "gone", "gone/gone", ".", "..", "~", "-", "out", "out/results.csv", "folder/x", "new", "ok.toml/x",
    "ok.ssp#gone.ssd", "ok.ssp#../x"
]  # fmt: skip
_NO_FILES += ["", "n" * 300, ODD, "new.ssp", "out/run.json", "\udcff"]
_NUMBERS = [
    "0", "-1", "1", "2", "0.001", "1e-4", "3e-4", "1e-5", "1e-300", "1e308", "1e400", "nan", "inf", "-inf",
    "1e9", "0x1", "1_000", "١", "x", "5e-324", "1,5"
]  # fmt: skip
_NUMBERS += ["", " ", "9" * 400, "1" + "0" * 5000, "0.00015", "1e-3"]
_TEXTS = [
    "x", "*", "lift.*", "lift.plant", "=", "[/]", "a=b", "--", "[", "{}", "%s", "rsba", "published",
    "lift.plant.x_L", "lift.plant,lift.controller"
]  # fmt: skip
_TEXTS += ["", " ", ODD, "x" * 5000, "é\n", "\udcff"]
_paths, _numbers = st.sampled_from([*FILES, *_NO_FILES]), st.sampled_from(_NUMBERS)
_texts = st.sampled_from(_TEXTS) | st.text("[]=.*<>'\"\\lift1e", max_size=9)
_components = st.sampled_from(["lift.plant", "lift", "", "x"])

_USEFUL: dict[str, Sequence[str]] = {
    "set": [f"lift.plant.start.x_L={x}" for x in (0.25, 0.24, "nan")]
    + ["lift.plant.internal_step=1e-9"]
    + ["*.start.x_L=250 mm", "*.x_L=1", "lift.*.qqq=1", "*=x", "lift.disturbance.load.level[*]=1 kN"],
    "replace": ["lift.plant=ok.fmu", "lift.plant=fmu-0.9.fmu", "lift.plant=gone", "lift.observer=ok.fmu"],
    "mapping": ["lift.plant=empty.ssm", "lift.plant=device"],
    "require": ["lift.position_error_m < 1", "steps_per_s > 1e308", "lift.torque_peak_N_m > 1"],
    "stop_when": ["lift.plant.x_L > 0.24", "lift.plant.x_L < 0", "x", "lift.plant.x_L > true"],
    "start_time": ["0", "0.001", "-0.001"],
    "stop_time": ["0.003", "0.0015", "0.00015", "1e308", "2 ms", "2 m", "1e999 d"],
    "step_size": ["1e-4", "0.1ms", "5e-5", "2e-4", "1e-3"],
    "error_tolerance": ["1e-2", "1e-3"],
    "output_interval": ["1e-3", "1e-4", "5e-4"],
    "real_time": ["1", "10", "1e9"],
    "coupling_tolerance": ["1e-6", "1e-300"],
    "controller": ["rsba", "block.py:B", "ok.fmu", "foc"],
    "gains": ["published", "robust"],
    "fault": [
        "lift.plant.x_measured=freeze@1e-3",
        "lift.observer.y=offset:1@0+1,lift.x.y=gain:1@0",
        "lift.plant=@",
    ],
    "input": [
        "out/results.csv:lift.reference.*",
        "device",
        "ok.toml",
        "gone.csv:lift.plant.F_L=x,end=repeat",
    ],
    "parameters": ["empty.ssv", "gone.ssv"],
    "signals": ["lift.plant.*", "*", "time"],
    "isolate": ["lift.plant", "lift.x"],
    "order": ["lift.plant,lift.controller,lift.observer,lift.reference,lift.disturbance", "lift.plant"],
    "output": ["out", "new", "folder", ODD],
    "reference": ["out", "gone", "folder", "ok.toml"],
    "tolerance": ["1e-3", "lift.*=1e9", "x=time:0,absolute:1"],
    "checkpoint": ["new", "ok.checkpoint", "folder/c", ODD],
    "resume": ["ok.checkpoint"],
    "step_multiples": [f"lift.controller={n}" for n in (5, 0, "x", "9" * 400)],
}
"""Values that mean something, where their type does not tell."""

_ONLY = {"fmus": ["ok.toml", "device", "ok.toml/x"], "platform": [host_platform(), "linux32", "x"]}
"""All values of options of which others would build all FMUs anew."""


def _values(option: Option) -> st.SearchStrategy[str]:
    """Texts for an option, right and wrong."""
    choices = [] if option.choices is None else list(option.choices())
    if option.name in _ONLY:
        return st.sampled_from(_ONLY[option.name])
    useful = st.sampled_from([*_USEFUL.get(option.name, ()), *choices] or ["x"])
    return _weighted((4, useful), (2, _typed(option.plain_type)), (1, _texts))


def _typed(kind: Any) -> st.SearchStrategy[str]:
    """Texts for a type."""
    inner = get_args(kind)
    if get_origin(kind) is Mapping:
        return st.builds("{}={}".format, _components, _typed(inner[1]))
    if inner:
        return st.one_of([_typed(k) for k in inner if k is not type(None)])
    return {float: _numbers, int: _numbers, Path: _paths}.get(kind, _texts)


def _with_value(option: Option) -> st.SearchStrategy[tuple[str, ...]]:
    """An option as it may be given."""
    flag = option.flag
    if option.type is bool:
        off = f"--no-{flag.removeprefix('--')}"
        return st.sampled_from([(flag,), (off,), (off,), (f"{flag}=x",)])
    values = _values(option)
    separate, joined = values.map(lambda v: (flag, v)), values.map(lambda v: (f"{flag}={v}",))
    return _weighted((5, separate), (4, joined), (1, st.just((flag,))))


# ---- commands --------------------------------------------------------------------------------------

_nonsense = st.sampled_from(
    ["--nope", "-x", "--", "-", "--help", "-h", "--version", "-1", "-q", "--set=", *FILES]
)
_stray = _nonsense.map(lambda text: (text,))
_good = st.sampled_from(["lift", "lift", "lift", "lift", "ok.toml", "ok.ssp", "link.ssp", *SCENARIOS])
_scenarios = _weighted((5, _good), (1, _paths))


def _options(command: str) -> st.SearchStrategy[list[tuple[str, ...]]]:
    drawn = st.one_of([_with_value(o) for o in list_options(command).values()])
    strays = st.lists(drawn | _stray, max_size=3)
    return _weighted((3, st.lists(drawn, max_size=2)), (2, st.lists(drawn, max_size=4)), (1, strays))


def _joined(*parts: Sequence[str]) -> tuple[str, ...]:
    return tuple(text for part in parts for text in part)


def _command(*head: Any, options: st.SearchStrategy[list[Any]]) -> st.SearchStrategy[tuple[str, ...]]:
    """A command of texts and strategies for texts, and its options."""
    texts = [part if isinstance(part, st.SearchStrategy) else st.just(part) for part in head]
    return st.builds(lambda first, more: _joined(first, *more), st.tuples(*texts), options)


_output = ("--fmus", FMUS, "--no-plots", "--output", "out")
_packages = _paths | st.sampled_from(["new.ssp", "ok.ssp"])
_records = _paths | st.sampled_from(["ok.json", "-q"])
_run = _command("run", _scenarios, *_output, "--stop-time", "0.002", options=_options(RUN))
_export = _command("export", _scenarios, _packages, "--fmus", FMUS, options=_options(EXPORT))
_rerun = _command("rerun", _records, *_output, options=_options(RUN))
_info_options = st.sampled_from(
    [("--json",), ("--json", "device"), ("--match", "*.x_L"), ("--match", ODD), ("--match",)]
)
_files = st.lists(_info_options | _paths.map(lambda path: ("--json", path)), max_size=2)
_info = _command(
    "info", _scenarios, "--fmus", FMUS, options=st.builds(lambda a, b: [*a, *b], _options(INFO), _files)
)
_model = st.sampled_from([*MODELS, "EmlaPlant", "x", ODD, "gone.py:B", "broken.py:B", "block.py:C", "folder"])
_more = st.sampled_from(
    [("--flavour", "python"), ("--flavour", "x"), ("--platform", "x"), ("--output", "device"), ("--output",)]
)
_build_options = st.lists(_more | _model.map(lambda model: (model,)), max_size=2)
_build = _command("build", _model, "--output", FMUS, "--platform", host_platform(), options=_build_options)
_names = st.sampled_from(["run", "list", "export", "ru"])
_words = st.lists(_nonsense | _texts | _names, max_size=4).map(tuple)
_list = st.lists(_nonsense | _texts, max_size=1).map(lambda more: ("list", *more))
commands = _weighted((12, _run), (3, _export), (2, _rerun), (3, _info), (1, _build), (1, _list), (2, _words))


# ---- surroundings ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Surroundings:
    """What is around a command: its streams, the environment, how large files may get."""

    streams: tuple[str, str, str] = (USABLE, USABLE, USABLE)
    encoding: str = "utf-8"
    environment: Mapping[str, str | None] = field(default_factory=dict)
    largest: int | None = None


_out = st.sampled_from([USABLE, USABLE, USABLE, CLOSED, FULL])
_VARIABLES = [("HOME", None), ("HOME", f"{FOLDER}/device"), ("EMLA_COSIM_CACHE", "device"), ("PATH", None)]
_VARIABLES += [("TMPDIR", f"{FOLDER}/gone"), ("TMPDIR", "device"), ("TERM", "dumb"), ("COLUMNS", "20")]
_VARIABLES += [
    ("COLUMNS", "x"), ("LC_ALL", "C"), ("LANG", "xx_YY.gbk"), ("PYTHONUTF8", "0"), ("NO_COLOR", "1")
]  # fmt: skip
surroundings = st.just(Surroundings()) | st.builds(
    Surroundings,
    st.tuples(st.sampled_from([USABLE, CLOSED]), _out, _out),
    st.sampled_from(["utf-8", "utf-8", "ascii", "gbk", "cp949", "latin-1"]),
    st.lists(st.sampled_from(_VARIABLES), max_size=2).map(dict),
    st.none() | st.sampled_from([0, 1, 100, 1000, 10_000, 100_000]),
)


def make_files(arguments: Sequence[str], folder: Path, materials: Materials) -> list[str]:
    """Make the files that a command names, `device` and `folder`; the command with the folder of FMUs."""
    text = "\0".join(arguments)
    for name, make in FILES.items():
        if name in text or name in ("device", "folder"):
            make(folder / name, materials)
    return [a.replace(FMUS, str(materials.fmus)) for a in arguments]

"""Plans are read and merged; invalid ones give one error message before any run, and leave no files."""

import json
import math
import shutil
from collections import namedtuple
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import polars
import pytest
from distributed import Client
from hypothesis import given, settings
from hypothesis import strategies as st

from emla_cosim.analyses.sweep.folder import SweepFolder
from emla_cosim.analyses.sweep.plan import Plan, load_plan
from emla_cosim.analyses.sweep.report import OUTPUTS
from emla_cosim.analyses.sweep.result import SweepResult
from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.analyses.variants.measures import Chunk, Measures, VariantOutcome
from emla_cosim.base.errors import CommandError
from emla_cosim.base.folder_lock import exclusive_lock
from emla_cosim.system.model import Component, System
from tests.support.commands import Emla, sentence
from tests.support.odd_files import ODD

R_S = "lift.plant.motor.R_s"
ONE_FACTOR: dict[str, Any] = {R_S: [0.1, 0.2]}
RUN: dict[str, Any] = {"stop_time": 0.002}


SweepLift = Callable[..., SweepResult]


@pytest.fixture(scope="module")
def sweep_lift(scheduler: Client, fmu_folder: Path) -> SweepLift:
    return partial(sweep, "lift", scheduler=scheduler, fmus=fmu_folder, **RUN)


VALUES: dict[str, Any] = {"distribution": "values", "values": [1.0]}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown parameter": ({"vary": {"lift.plant.motor.R_z": [1.0]}}, r"lift\.plant.*motor\.R_[sz]"),
    "unknown component": ({"vary": {"lift.plant2.motor.R_s": [1.0]}}, "lift.plant"),
    "no name": ({"vary": {"stop_tim": [1.0]}}, "did you mean stop_time?"),
    "pattern of nothing": ({"vary": {"lift.nothing.*": "±10%"}}, "lift.nothing"),
    "computed": ({"vary": {"lift.plant.x_L": [0.1]}}, "by the FMU; did you mean lift.plant.start.x_L"),
    "driven": ({"vary": {"lift.plant.u_q": [0.1]}}, "driven by lift.controller.u_q"),
    "empty range": ({"vary": {R_S: "0.3:0.1:5"}}, "0.3 to 0.1 is an empty range"),
    "no levels": ({"vary": {R_S: "normal(0.1, 0.01)"}}, f"'{R_S}' of .* a grid needs levels"),
    "varied twice": ({"vary": {**ONE_FACTOR, "r": {"of": [R_S], **VALUES}}}, f"varies {R_S} twice"),
    "pattern again": ({"vary": {**ONE_FACTOR, "lift.plant.motor.R*": [1.0]}}, "two factors"),
    "a column's name": ({"vary": {"status": {"of": [R_S], **VALUES}}}, "is a reserved column name"),
    "fixed option": ({"vary": {"isolate": [True]}}, "isolate cannot vary between variants"),
    "relative to nothing": ({"vary": {"gains": "90%,110%"}}, "no number in the scenario"),
    "nothing varies": ({"vary": {}}, "varies nothing"),
    "no table": ({"vary": ["a"]}, "must be a table"),
    "signals as text": ({"signals": "lift.plant.x_L"}, "must be a list"),
    "metric of a factor's name": ({"metrics": [f"{R_S} = max(time)"]}, "a factor and of a figure"),
    "unknown metric": ({"metrics": ["lift.torque_peak"]}, "did you mean lift.torque_peak_N_m"),
    "unknown in expression": ({"metrics": ["a = max(lift.plant.i_qq)"]}, "Did you mean lift.plant.i_q"),
    "unknown signal": ({"signals": ["lift.plant.x_LL"]}, "did you mean lift.plant.x_L"),
    "seed": ({"seed": -1}, "'seed' of the sweep of .* is -1; it must be at least 0"),
    "runs of a grid": ({"runs": 3, "sampling": "grid"}, "does not accept a number of runs"),
    "workers": ({"workers": 0}, "at least 1"),
    "scheduler": ({"scheduler": 3}, "the scheduler is 3"),
    "many levels": ({"vary": {R_S: "0.1:0.2:1000000000000"}}, "1000000000000 variants;"),
    "large grid": ({"vary": {f"lift.plant.motor.{n}": "0.1:0.2:10000" for n in ("R_s", "L_d", "L_q")}},
                   "1000000000000 variants;"),
    "option of one run": ({"real_time": 1.0}, "real_time is for a single run"),
    "unknown option": ({"step_sise": 1.0}, "did you mean 'step_size'?"),
    "resume without a folder": ({"resume": True, "output": None}, "set `output` to its folder"),
    "resume of nothing": ({"resume": True}, "has no sweep to resume"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_invalid_plans(name: str, sweep_lift: SweepLift, tmp_path: Path) -> None:
    arguments, expected = WRONG[name]
    with pytest.raises(CommandError, match=expected) as caught:
        sweep_lift(**{"vary": ONE_FACTOR, "output": tmp_path / "a/out", **arguments})
    text = str(caught.value)
    assert "\n" not in text and text[-1] in ".?"
    assert not list(tmp_path.iterdir())


def test_too_large_results_are_refused(
    sweep_lift: SweepLift, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")(2**30, 2**30, 5000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(CommandError, match=r"the results of 50 variants take up to .* keep fewer signals"):
        sweep_lift({R_S: "0.1:0.2:50"}, signals=["*"], output=tmp_path / "out")
    assert not (tmp_path / "out").exists()


PLAN = f'scenario = "lift"\nstop_time = 0.002\n[vary]\n"{R_S}" = [0.1]\n'
FILES: dict[str, tuple[bytes, str]] = {
    "no TOML": (b"vary = [", "the plan 'p.toml' is not TOML: "),
    "unknown key": (b'sead = 3\n' + PLAN.encode(), "did you mean 'seed'?"),
    "no scenario": (PLAN.replace("scenario", "description").encode(), "lacks scenario, the name"),
    "key of one run": (b"real_time = 1.0\n" + PLAN.encode(), "has the unknown entry 'real_time'"),
    "vary is not a table": (b'scenario = "lift"\nvary = 3\n', "'vary' of the plan"),
    "empty": (b"", "."),
    "no text": (b"\xff\xfe\x00", "not a text in UTF-8"),
    "NUL": (PLAN.encode() + b"\0", "."),
    "runs": (b'runs = "many"\n' + PLAN.encode(), "'runs' of the plan"),
    "metrics": (b"metrics = 3\n" + PLAN.encode(), "must be a list"),
    "lone surrogate": (b'description = "\\ud800"\n' + PLAN.encode(), "."),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_invalid_plan_files(name: str, emla: Emla, fmu_folder: Path) -> None:
    content, expected = FILES[name]
    Path("p.toml").write_bytes(content)
    result = emla("sweep", "p.toml", "--fmus", str(fmu_folder))
    assert expected in sentence(result, 2)
    assert [p.name for p in Path().iterdir()] == ["p.toml"]


@pytest.mark.parametrize("path", ["/dev/null", "gone.toml", ".", "nul\0.toml"])
def test_paths_that_are_not_plan_files(path: str, emla: Emla) -> None:
    sentence(emla("sweep", path, "--vary", f"{R_S}=0.1"), 2)
    assert not list(Path().iterdir())


@pytest.mark.parametrize("text", [R_S, f"{R_S}=", "=3", ""])
def test_incomplete_vary_options(text: str, emla: Emla) -> None:
    assert "has no name or no values" in sentence(emla("sweep", "lift", "--vary", text), 2)


def test_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_bytes(b"\xef\xbb\xbf" + PLAN.encode())
    assert load_plan(tmp_path / "p.toml").vary == {R_S: [0.1]}


names = st.from_regex(r"[a-z]{1,5}(\.[a-z]{1,4}){0,2}", fullmatch=True)
numbers = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**53), 2**53)
values = st.lists(numbers | st.booleans() | st.text(st.characters(codec="utf-8")), min_size=1, max_size=4)


@given(st.dictionaries(names, values, min_size=1, max_size=4), st.integers(0, 2**63 - 1))
def test_plans_are_read_as_written(
    tmp_path_factory: pytest.TempPathFactory, vary: dict[str, list[Any]], seed: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "written.toml"
    lines = [f"{json.dumps(name)} = {json.dumps(entry, ensure_ascii=False)}" for name, entry in vary.items()]
    text = "\n".join(['scenario = "lift"', f"seed = {seed}", "[vary]", *lines])
    path.write_text(text.replace("\x7f", "\\u007f"), "utf-8")
    plan = load_plan(path)
    assert (dict(plan.vary), plan.seed) == (vary, seed)


def merge(parts: list[list[int]], path: Path) -> None:
    """A folder with these variants in parts, merged."""
    folder = SweepFolder(OUTPUTS, path)
    path.mkdir(parents=True)
    about = polars.DataFrame({"variant": range(12), "x": [float(n) for n in range(12)]})
    record = {"identity": {}, "name": "12", "sampling": "grid", "seed": 0, "factors": {"x": []}}
    record |= {"figures": ["y"], "signals": [], "units": {}, "shown": {}, "required": [], "base": None}
    folder.begin(record, about, resume=False)
    for part in parts:
        outcomes = [VariantOutcome(n, "done", None, 1.0, {"y": math.sqrt(n)}) for n in part]
        folder.keep_chunk(Chunk(outcomes), Measures(figures=["y"]))
    assert folder.list_finished() == set(range(12))
    folder.finish(True, 1.0)


@settings(max_examples=20)
@given(data=st.data())
def test_table_does_not_depend_on_its_parts(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    order = data.draw(st.permutations(range(12)))
    cuts = sorted(data.draw(st.sets(st.integers(1, 11))))
    parts = [order[i:j] for i, j in zip([0, *cuts], [*cuts, 12], strict=True)]
    base = tmp_path_factory.mktemp("parts")
    for name, split in (("one", [list(range(12))]), ("many", parts)):
        merge(split, base / name)
    first, second = ((base / name / "variants.parquet").read_bytes() for name in ("one", "many"))
    assert first == second


def test_content_of_a_folder_decides_what_can_be_resumed(sweep_lift: SweepLift, tmp_path: Path) -> None:
    out = tmp_path / "out"
    plan: dict[str, Any] = {"vary": {R_S: [0.9, 1.1]}, "metrics": ["lift.torque_peak_N_m"], "output": out}
    first = sweep_lift(**plan)
    before = (out / "variants.parquet").read_bytes()
    changes: dict[str, dict[str, Any]] = {
        "values": {"vary": {R_S: [0.9, 1.2]}},
        "seed": {"seed": 1},
        "metrics": {"metrics": ["lift.held"]},
        "FMUs or settings": {"gains": "published"},
        "sampling": {"sampling": "one-at-a-time", "vary": {R_S: "0.9:1.1"}},
    }
    same_numbers = [{R_S: "90%,110%"}, {"k": {"of": [R_S], "distribution": "values", "values": [0.9, 1.1]}}]
    more = [("values", {"vary": vary}) for vary in same_numbers]
    more.append(("FMUs or settings", {"kind": {"lift.plant": "me"}}))
    for name, changed in [*changes.items(), *more]:
        with pytest.raises(CommandError, match=f"cannot be resumed: it has different .*{name}"):
            sweep_lift(**{**plan, **changed}, resume=True)
    assert sweep_lift(**plan, resume=True).variants.equals(first.variants)
    assert (out / "variants.parquet").read_bytes() == before

    record = json.loads((out / "sweep.json").read_text())
    (out / "sweep.json").write_text(json.dumps({**record, "status": "unfinished"}))
    with pytest.raises(CommandError, match="has an unfinished sweep; --resume continues it"):
        sweep_lift(**plan)
    (out / "parts").mkdir()
    (out / "parts/000000000.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(CommandError, match=r"parts/000000000.parquet' cannot be read; remove it"):
        sweep_lift(**plan, resume=True)
    (out / "parts/000000000.parquet").unlink()
    assert sweep_lift(**plan, resume=True).complete
    assert (out / "variants.parquet").read_bytes() == before
    with exclusive_lock(out), pytest.raises(CommandError, match="another run writes to"):
        sweep_lift(**plan)
    empty = tmp_path / "empty"
    empty.mkdir()
    (empty / "sweep.json").touch()
    assert sweep_lift(**{**plan, "output": empty}).complete
    (out / "sweep.json").write_text("[]")
    with pytest.raises(CommandError, match=r"has 'sweep\.json', which was not written by emla"):
        sweep_lift(**plan)
    assert sweep_lift(**plan, overwrite=True).complete


@pytest.mark.parametrize("strange_file", ["series", "parts", "strange", "link", "folder", "device"])
def test_files_of_others_are_kept(strange_file: str, sweep_lift: SweepLift, tmp_path: Path) -> None:
    """An output folder may contain files with the names that a sweep uses."""
    out, backup = tmp_path / "out", tmp_path / "other"
    files = {"series": "series/000000000.parquet", "parts": "parts/mine.csv", "strange": "series/mine.csv"}
    for path in (out / files.get(strange_file, "mine.csv"), backup / "000000000.parquet"):
        path.parent.mkdir(parents=True)
        path.write_text("years of work")
    if strange_file == "strange":
        (out / "sweep.json").write_text('{"identity": {}, "status": "completed"}')
    elif strange_file == "link":
        (out / "series").symlink_to(backup)
    elif strange_file == "folder":
        (out / "variants.parquet").mkdir()
    elif strange_file == "device":
        (out / "worst.txt").symlink_to("/dev/null")
    before = {path: path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    refusal = r"does not belong to a sweep; move it|not written by emla|the file .* cannot be written"
    with pytest.raises(CommandError, match=refusal):
        sweep_lift(ONE_FACTOR, output=out)
    assert {path: path.read_text() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_output_that_cannot_be_written(sweep_lift: SweepLift, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file/below", "nul\0", "x" * 300):
        with pytest.raises(CommandError, match=r"the output folder .* cannot be written: .*"):
            sweep_lift(ONE_FACTOR, output=path)


def test_names_with_special_characters(scheduler: Client, faulty_fmu: Path, tmp_path: Path) -> None:
    name = f"j.{ODD}"
    system = System((Component(name, "Faulty", {"b": 0.5}, faulty_fmu),), ())
    result = sweep(
        system, {f"{name}.b": [0.1, 0.2]}, metrics={ODD: f"max({name}.y)"}, signals=[f"{name}.y"],
        stop_time=0.2, step_size=0.1, scheduler=scheduler, output=tmp_path / "out",
    )  # fmt: skip
    assert result.variants["status"].to_list() == ["done", "done"]
    assert result.factors == [f"{name}.b"]
    assert result.variants[f"{name}.b"].to_list() == [0.1, 0.2]
    assert json.loads((tmp_path / "out/sweep.json").read_text())["signals"] == [f"{name}.y"]
    assert result.series is not None and f"{name}.y" in result.series.collect().columns


def test_paths_in_a_plan_are_relative_to_its_folder(tmp_path: Path) -> None:
    away = tmp_path / "away"
    away.mkdir()
    text = 'scenario = "lift"\n[vary]\n"lift.plant" = ["a.fmu", "/b.fmu"]\n"lift.observer" = "c.fmu"\n'
    table = '"lift.reference" = { distribution = "values", values = ["d.fmu"] }\n'
    (away / "p.toml").write_text(text + table)
    assert load_plan(away / "p.toml").vary == {
        "lift.plant": [str(away / "a.fmu"), "/b.fmu"],
        "lift.observer": str(away / "c.fmu"),
        "lift.reference": {"distribution": "values", "values": [str(away / "d.fmu")]},
    }


def test_overrides_are_merged_into_tables() -> None:
    plan = Plan("p", "lift", {"a.x": [1]}, options={"stop_time": 1.0, "set": {"a.y": 1.0, "a.z": 2.0}})
    changed = plan.updated({"vary": {"a.w": [2]}, "options": {"stop_time": 2.0, "set": {"a.z": 3.0}}})
    assert changed.vary == {"a.x": [1], "a.w": [2]}
    assert changed.options == {"stop_time": 2.0, "set": {"a.y": 1.0, "a.z": 3.0}}
    assert plan.options["set"] == {"a.y": 1.0, "a.z": 2.0}


@pytest.mark.parametrize(
    ("changes", "runs"),
    [
        ({"sampling": "one-at-a-time"}, None),
        ({"sampling": "grid", "runs": None}, None),
        ({"sampling": "grid", "runs": 7}, 7),  # which is for the sampling to refuse
        ({"sampling": "sobol"}, 2000),
        ({"seed": 3}, 2000),
    ],
)
def test_sampling_without_runs_drops_the_runs_of_the_plan(changes: dict, runs: int | None) -> None:
    plan = Plan("p", "lift", {"a.x": [1, 2]}, sampling="random", runs=2000)
    assert plan.updated(changes).runs == runs

"""Tolerances of a sizing equal a loop over sizings with the same values."""

import itertools
import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import polars
import pytest

import emla_cosim as ec
from emla_cosim.analyses.size.limits import Utilisation
from emla_cosim.analyses.size.pictures import draw_limits, draw_motion
from emla_cosim.analyses.size.tolerances import Draw, Tolerances
from tests.support.commands import Emla
from tests.support.paths import ROOT

SHEET = ROOT / "docs/roller-screw.toml"

SHORT_RUN: dict[str, Any] = {"stop_time": 0.4, "lead_in": 0.1}
RUN = SHORT_RUN | {"actuator": {"prototype": SHEET}}

LOAD, MASS = "prototype.disturbance.load.level[1]", "prototype.plant.screw.M_BS"
LIGHT = {LOAD: 1000.0}

pytestmark = pytest.mark.usefixtures("scheduler")


@pytest.fixture(scope="module")
def size(fmu_folder: Path) -> Callable[..., ec.SizeResult]:
    return partial(ec.size, "prototype", workers=1, fmus=fmu_folder)


def fractions(limits: Any) -> dict[str, float]:
    return {limit.name: limit.fraction for limit in limits}


def test_ends_equal_a_loop_over_sizings(size: Callable[..., ec.SizeResult]) -> None:
    """Bit by bit, also where only the ambient temperature differs, which no run knows."""
    vary = {MASS: "80%:120%", "ambient": "20degC:120degC"}
    result = size(vary=vary, set=LIGHT, **RUN)
    joint = result["prototype"]
    mass = joint.cycle.emla.M_BS
    ends = itertools.product([0.8 * mass, 1.2 * mass], [293.15, 393.15])
    assert joint.tolerances is not None and not joint.tolerances.is_random
    for draw, (mass, ambient) in zip(joint.tolerances.draws, ends, strict=True):
        assert list(draw.values.values()) == pytest.approx([mass, ambient])
        values = LIGHT | {MASS: draw.values[MASS]}
        single = size(set=values, ambient=draw.values["ambient"], **RUN)["prototype"]
        assert list(fractions(draw.limits).items()) == list(fractions(single.limits).items())
        assert draw.reasons == single.reasons
        assert draw.holds is single.holds
    for limit in joint.tolerances.limits(joint.limits):
        used = {id(draw): fractions(draw.limits)[limit.worst.name] for draw in joint.tolerances.draws}
        assert limit.worst.fraction == max(used.values()) == used[id(limit.at)]
        assert limit.margin == 1.0 - limit.worst.fraction
        assert limit.nominal == fractions(joint.limits)[limit.worst.name]


def test_each_candidate_has_its_own_draws(size: Callable[..., ec.SizeResult]) -> None:
    """Relative tolerances refer to the candidate; entries of data sheets vary, too."""
    text = SHEET.read_text(encoding="utf-8")
    heavy = ec.Actuator.read(SHEET).changed({"screw": {"M_BS": "60 lb"}}, "heavy")
    assert "30 lb" in text
    vary = {MASS: "50%,150%", "actuator.screw.F_max": "6 kN,12 kN"}
    result = size(candidates={"prototype": [str(SHEET), heavy]}, vary=vary, set=LIGHT, **SHORT_RUN)
    for candidate, pounds in zip(result.candidates, (30.0, 60.0), strict=True):
        sizing = candidate.joints["prototype"]
        assert sizing.tolerances is not None
        masses = [draw.values[MASS] for draw in sizing.tolerances.draws]
        assert masses == pytest.approx([f * pounds * 0.45359237 for f in (0.5, 0.5, 1.5, 1.5)])
        weak, strong, *_ = (fractions(draw.limits)["axial force"] for draw in sizing.tolerances.draws)
        assert weak == pytest.approx(2.0 * strong)
    draw = result["prototype"].tolerances.draws[0]  # type: ignore[union-attr]
    changed = ec.Actuator.read(SHEET).changed({"screw": {"F_max": "6 kN"}}, "weak")
    single = size(set=LIGHT | {MASS: draw.values[MASS]}, **(RUN | {"actuator": {"prototype": changed}}))
    assert fractions(draw.limits) == fractions(single["prototype"].limits)


def test_a_failing_draw_decides(emla: Emla, tmp_path: Path) -> None:
    """A load that no motor can hold ends its run; the draw counts, with its reason."""
    run = ("size", "prototype", "--actuator", f"prototype={SHEET}", "--set", f"{LOAD}=1000")
    run = (*run, "--stop-time", "400ms", "--lead-in", "0.1s", "--no-plots", "--output", "out")
    result = emla(*run, "--vary", f"{LOAD}=500 N, 24 MN", "--report", "--workers", "1")
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "1 of 2 combinations of the ends do not hold" in text
    assert "does not hold" in text and "The load of 2.4e+04 kN" in text
    record = json.loads((tmp_path / "out/size.json").read_text(), parse_constant=pytest.fail)
    joint = record["candidates"][0]["joints"]["prototype"]
    assert joint["holds"] is False and all(limit["holds"] for limit in joint["limits"])
    assert joint["tolerances"]["not_holding"] == 1
    table = polars.read_csv(tmp_path / "out/tolerances.csv")
    assert table["holds"].to_list() == [True, False]
    assert table[LOAD].to_list() == [500.0, 24e6]
    assert "1 of 2 combinations" in (tmp_path / "out/size.html").read_text(encoding="utf-8")
    assert emla(*run).exit_code == 0
    assert not (tmp_path / "out/tolerances.csv").exists()


def test_an_ambient_without_effect_is_reported(emla: Emla) -> None:
    """Also with a time limit, which the runs of draws have like those of a sweep."""
    run = ("size", "prototype", "--stop-time", "400ms", "--lead-in", "0.1s", "--no-plots", "--workers", "1")
    result = emla(*run, "--vary", "ambient=20degC:60degC", "--timeout", "60s")
    assert result.exit_code == 0, result.output
    assert "ambient changes nothing: only the limit thermal.T_max" in " ".join(result.stdout.split())


def test_an_interrupt_in_the_draws_keeps_the_rest(
    size: Callable[..., ec.SizeResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any) -> Any:
        raise ec.RunError("interrupted after 1 of 2 runs.")

    monkeypatch.setattr("emla_cosim.analyses.size.runner.run_draws", interrupt)
    with pytest.raises(ec.RunError, match=r"1 of 2 runs\. The results without tolerances are in "):
        size(vary={"ambient": "20degC:60degC"}, output=tmp_path, plots=False, **RUN)
    assert {"size.json", "limits.csv", "cycles.csv"} == {file.name for file in tmp_path.iterdir()}
    record = json.loads((tmp_path / "size.json").read_text())
    remarks = record["candidates"][0]["joints"]["prototype"]["remarks"]
    assert "the tolerances are not judged: interrupted after 1 of 2 runs." in remarks


def test_random_draws_state_their_confidence(size: Callable[..., ec.SizeResult]) -> None:
    study, repeated = (
        size(vary={"ambient": "20degC:60degC"}, runs=59, seed=3, set=LIGHT, **RUN)["prototype"].tolerances
        for _ in range(2)
    )
    assert study is not None and repeated is not None
    assert study.sentence == "0 of 59 do not hold: below 5 % with 95 % confidence"
    ambient = [float(draw.values["ambient"]) for draw in study.draws]
    assert ambient == [draw.values["ambient"] for draw in repeated.draws]
    assert 293.15 < min(ambient) < 300.0 and 326.0 < max(ambient) < 333.15
    hot = next(use for use in study.limits(()) if use.worst.name == "winding temperature")
    assert hot.at.values["ambient"] == max(ambient)
    assert hot.quantile == sorted(fractions(d.limits)["winding temperature"] for d in study.draws)[56]
    assert hot.quantile_interval[0] < hot.quantile <= hot.worst.fraction


def test_failed_runs_are_beyond_any_quantile() -> None:
    limit = Utilisation("speed", 1.0, 2.0, "m/s", 0.5, "screw.v_max")
    draws = [Draw({"x": float(i)}, [limit] if i else (), None if i else "it broke.") for i in range(10)]
    (use,) = Tolerances({"x": ""}, True, 0, draws).limits([limit])
    assert use.worst.fraction == 0.5 and use.quantile == math.inf
    assert Tolerances({"x": ""}, True, 0, draws).failures == draws[:1]
    assert draws[0].reasons == ["it broke"]


def test_plots_have_all_candidates_and_their_worst_draws(size: Callable[..., ec.SizeResult]) -> None:
    heavy = ec.Actuator.read(SHEET).changed({"screw": {"F_max": "6 kN"}}, "weak")
    candidates, vary = {"prototype": [str(SHEET), heavy]}, {LOAD: [1000.0, 2000.0]}
    result = size(candidates=candidates, vary=vary, set=LIGHT, **SHORT_RUN)
    sizings = {candidate.label: candidate.joints["prototype"] for candidate in result.candidates}
    axes: Any = draw_limits(sizings).axes[0]
    row = [label.get_text() for label in axes.get_yticklabels()].index("axial force")
    bars = [bar.get_width() for bar in axes.patches if abs(bar.get_y() + 0.5 * bar.get_height() - row) < 0.45]
    used = [100.0 * fractions(candidate.limits)["axial force"] for candidate in sizings.values()]
    assert bars == pytest.approx(used)
    assert used[1] == pytest.approx(12.01 / 6.0 * used[0], rel=1e-3)
    ends = {line.get_xdata()[1] for line in axes.lines if abs(line.get_ydata()[0] - row) < 0.45}
    for candidate in sizings.values():
        assert candidate.tolerances is not None
        assert (
            max(100.0 * fractions(draw.limits)["axial force"] for draw in candidate.tolerances.draws) in ends
        )
    assert [len(candidate.lines) for candidate in draw_motion(sizings).axes] == [2, 2, 2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vary": {"prototype.plant.motor.Rs": "±10%"}}, "has no variable 'motor.Rs'"),
        ({"vary": {"stop_time": "1:2"}}, "is not a tolerance"),
        ({"vary": {"actuator": "a.toml,b.toml"}}, "Several actuators are candidates"),
        ({"vary": {"prototype.reference.period": "1:2"}}, "is not a tolerance"),
        ({"vary": {"ambient": "20:40"}}, "write temperatures with their unit"),
        ({"vary": {"ambient": "±10%"}}, "write temperatures with their unit"),
        ({"vary": {"ambient": [0.0, 300.0]}}, "above 0 K"),
        (
            {"vary": {"actuator.motor.i_nominal": "1 A rms,2 A rms"}},
            "no draw can run; with actuator.motor.i_nominal = 1 A rms: ",
        ),
        ({"vary": {"prototype.plant.motor.*": "1:2"}}, "combinations of their ends; the most are 64"),
        ({"runs": 5}, "add 'vary'"),
        ({"workers": None, "scheduler": "tcp://there:1"}, "'scheduler' is for tolerances"),
        ({"seed": 3}, "a seed is for random draws"),
        ({"vary": {LOAD: "1:2"}, "runs": 0}, "it must be 1 or more"),
    ],
)
def test_invalid_tolerances(
    options: dict[str, Any], message: str, size: Callable[..., ec.SizeResult]
) -> None:
    with pytest.raises(ec.CommandError, match=message):
        size(**options, **RUN)

"""The winding temperature that a short run predicts, against a long run of the same motion."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import emla_cosim as ec

PERIOD, TAU = 2.0, 2.0
RISE = "lift.plant.motor.temperature_rise"
MOTION = {
    "period": PERIOD,
    "waypoint[2]": 0.27,
    **{f"waypoint[{i}]": 0.244 for i in (1, *range(3, 10))},
    "move.start[1]": 0.0,
    "move.duration[1]": 0.8,
    "move.start[2]": 1.0,
    "move.duration[2]": 0.6,
}
"""Out and back, with different speeds and a rest."""

CALM = {f"d_2.{name}": 0.0 for name in ("amplitude[1]", "amplitude[2]", "arctan")}
"""The disturbances of the screw do not have the period of the motion."""


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift", gains="damped").prepare(fmus=fmu_folder) as simulation:
        yield simulation


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"lift.plant.motor.alpha_R": 3.93e-3, "lift.disturbance.load.level[1]": -45e3},
        {"lift.plant.motor.permitted_rise": 60.0, RISE: 30.0, "lift.plant.gearbox.directional": True},
    ],
    ids=["nominal", "resistance and other load", "warm start"],
)
def test_prediction_agrees_with_a_long_run(values: dict[str, float], lift: ec.Simulation) -> None:
    drive = {"lift.plant.motor.i_N": 12.0, "lift.plant.motor.tau_th": TAU}
    motion = {f"lift.reference.{name}": value for name, value in MOTION.items()}
    start_values = (
        motion | {f"lift.disturbance.{name}": value for name, value in CALM.items()} | drive | values
    )

    def run(stop_time: float, over: float) -> ec.Result:
        criteria = {"lift.over_temperature": over}
        return lift.run(set=start_values, stop_time=stop_time, output_interval=5e-3, criteria=criteria)

    long = run(16.0, 1e9)
    warm = long[RISE][long.time > 16.0 - PERIOD]
    cold = run(2.5, 1e9).metrics["joints"]["lift"]["heat"]
    assert cold["until_s"] - cold["from_s"] == pytest.approx(PERIOD)
    assert cold["steady_rise_K"] == pytest.approx(warm.max(), rel=0.01)
    assert cold["mean_rise_K"] == pytest.approx(warm.mean(), rel=0.01)
    load = long["lift.plant.motor.load"][long.time > 16.0 - PERIOD]
    assert cold["copper_load"] == pytest.approx(load.mean(), rel=0.01)
    # a trip at a temperature that only the later cycles reach
    threshold = 0.5 * (warm.max() + long[RISE][long.time <= 2.5].max())
    predicted = run(2.5, threshold / cold["permitted_rise_K"] - 1.0).metrics["joints"]["lift"]
    expected = long.time[long[RISE] > threshold][0]
    assert predicted["held"] and expected > 2.5
    assert predicted["heat"]["trips_at_s"] == pytest.approx(expected, abs=0.05)

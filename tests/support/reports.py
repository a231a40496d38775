"""Reports as `verify` might make them, in memory: ordinary ones, long ones and hostile ones."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from emla_cosim.base.tolerances import Comparison, Tube
from fmu_verify.check import CheckOutcome, Clause, failed, passed, skipped, warned
from fmu_verify.findings import Examined, Finding
from fmu_verify.report import Report

CLAUSE = Clause("2.1.5", "The function returns a new instance of an FMU.")
STARTED = "2026-11-22T11:53:17+00:00"
ATTACK = "document.title='taken'"
HOSTILE = f'</script><script>{ATTACK}</script><img src=x onerror="{ATTACK}">{{{{7*7}}}}&"\'`'
UNSEEN = "bell\x07 nul\x00 escape\x1b[31m next\x85line over\u202eride mark\u200f half\udc80 none\uffff"


def compared(signal: str, points: int = 500, drift: float = 0.0, unit: str = "m") -> Comparison:
    """A damped oscillation, off by half its tube, and by `drift` tubes per second after 2 s."""
    time = np.linspace(0, 5, points)
    reference = np.exp(-0.3 * time) * np.sin(7 * time + len(signal))
    tube = Tube(1e-2, 0.005)
    lower, upper = tube.edges(time, time, reference)
    lower, upper = lower - tube.value, upper + tube.value
    values = reference + tube.value * (0.5 * np.sin(31 * time) + drift * np.maximum(0, time - 2))
    return comparison(signal, unit, time, values, reference, lower, upper, tube)


def comparison(
    signal: str, unit: str, time: Any, values: Any, reference: Any, lower: Any, upper: Any, tube: Tube
) -> Comparison:
    """With the worst deviation and the first point outside as they are; NaN is outside."""
    with np.errstate(all="ignore"):
        away = np.abs(values - reference)
        outside = ~((values >= lower) & (values <= upper))
    worst = int(np.argmax(away))
    exit_time = float(time[np.argmax(outside)]) if outside.any() else None
    return Comparison(
        signal,
        unit,
        time,
        values,
        time,
        reference,
        lower,
        upper,
        tube,
        float(away[worst]),
        float(time[worst]),
        exit_time,
    )


def finding(check: str, outcome: CheckOutcome, title: str = "Something is as it should be") -> Finding:
    return Finding(check, title, outcome, CLAUSE, "Do it right.", 0.1234, "Look at it.")


def examined(path: str, findings: Sequence[Finding], **facts: str) -> Examined:
    return Examined(Path(path), {"FMI": "2.0", "SHA-256": "fa946cd1" * 8, **facts}, tuple(findings), 1.5)


def report(*all_of_it: Examined) -> Report:
    return Report(all_of_it, "0.1.0", STARTED)


def ordinary() -> Report:
    """Two FMUs of one name: one with every verdict, one that passes."""
    signals = (compared("x"), compared("motor.v", drift=3), compared("motor.i", drift=1))
    return report(
        examined(
            "build/Plant.fmu",
            [
                finding("archive.safe", passed("Its 12 entries were unpacked.", figures={"entries": 12})),
                finding("description.units", warned("motor.v has no unit.", details=("Line 7.", "Line 9."))),
                finding("state.restored", failed("x is 2 where it was 1.", details=("v is 3, was 4.",))),
                finding("state.serialized", skipped("It needs state.restored, which failed.")),
                finding("reference.tube", failed("motor.v leaves its tube.", comparisons=signals)),
            ],
            model="Plant",
        ),
        examined(
            "other/Plant.fmu",
            [
                finding("archive.safe", passed("Its 3 entries were unpacked.")),
                finding("reference.tube", passed("All stay inside.", comparisons=(compared("alone"),))),
            ],
        ),
    )


def ten() -> Report:
    """Ten FMUs with 60 signals of 500 points in all, and 30 checks each."""
    fmus = [
        examined(
            f"fmus/Model{k % 5}/{'python/' if k > 4 else ''}Model{k % 5}.fmu",
            [
                *(finding(f"group{n % 7}.check_{n}", passed("All is as it should be.")) for n in range(29)),
                finding(
                    "reference.tube",
                    passed("Inside.", comparisons=tuple(compared(f"s{n}.x") for n in range(6))),
                ),
            ],
        )
        for k in range(10)
    ]
    return report(*fmus)


def hostile() -> Report:
    """Every text that may come from an FMU tries to be more than text; numbers are as bad as they get."""
    time = np.linspace(0, 1, 200)
    wild = np.full(200, 1.0)
    wild[[3, 50, 70, 90]] = np.nan, np.inf, 1.7e308, -1.7e308
    zero, long = np.zeros(200), "x" * 10_000
    signals = (
        comparison(HOSTILE, HOSTILE, time, wild, zero, zero - 1e308, zero + 1e308, Tube(1e308, 0)),
        comparison(UNSEEN, "m\x00", time, wild, zero, zero - 0.5, zero + 0.5, Tube(0.5, 0)),
        comparison(long, long, time, wild * np.nan, wild * np.nan, zero, zero, Tube(np.nan, np.inf)),
        comparison("none", "", time, wild * np.nan, zero, zero * np.nan, zero * np.nan, Tube(0, 0)),
        comparison("same", "", time, zero + 1e15, zero + 1e15, zero + 1e15, zero + 1e15, Tube(0, 0)),
        comparison("tiny", "", time, zero + 5e-324, zero, zero - 5e-324, zero + 5e-324, Tube(5e-324, 0)),
        comparison("alone", "", time[:1], zero[:1], zero[:1], zero[:1], zero[:1], Tube(1, 1)),
    )
    texts = (HOSTILE, UNSEEN, long, "עברית ‏ and العربية", "]]>", "<!-- <![CDATA[")
    figures = {
        HOSTILE: np.float64("nan"), UNSEEN: np.inf, "array": np.arange(3.0), "path": Path("/x"), "none": None,
        "huge": 10**400, "nested": {"a": [np.int64(1), (np.nan,)]}, "yes": np.bool_(True),
    }  # fmt: skip
    findings = [
        *(
            finding(f"text.n{k}", failed(text, details=texts, hint=text), title=text)
            for k, text in enumerate(texts)
        ),
        finding("text.warned", warned(UNSEEN + HOSTILE, details=texts)),
        finding("text.skipped", skipped(UNSEEN + HOSTILE)),
        finding("reference.tube", failed(HOSTILE, comparisons=signals, figures=figures)),
    ]
    bad = Finding("text.clause", "t", failed("f"), Clause(HOSTILE, UNSEEN, HOSTILE), HOSTILE, float("nan"))
    facts = {HOSTILE: HOSTILE, UNSEEN: UNSEEN, "model": long}
    return Report(
        (
            Examined(
                Path(f"{HOSTILE}/{UNSEEN}.fmu".replace("\x00", "")), facts, (*findings, bad), float("inf")
            ),
            Examined(Path(long + ".fmu"), {}, (), 0.0),
        ),
        HOSTILE,
        HOSTILE,
    )

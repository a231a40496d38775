"""Remarks below the tables of a comparison: what marks a winner, and what is not equal."""

import math
from collections.abc import Iterator, Mapping, Sequence

from ...base.errors import join_names
from .rows import OBSERVER, RANDOM, RESERVES, SEED, SHOWN, Row, label_variant
from .statistics import LEVEL, SeedStatistics, fewest_wins, group_by_variant, rank

FEWEST_SEEDS = math.ceil(1.0 - math.log2(LEVEL))
"""Smallest number of seeds with which a winner can be significant: winning all of n has 2 / 2^n by chance."""

_EFFORT, _MORE = "torque_effort_N_m", 1.05
"""The figure of torque effort, and the ratio from which it is not equal: 5 %, about the spread of tilt."""


def describe_ranking(rows: Sequence[Row]) -> list[str]:
    """Return the remarks that belong beside marked winners."""
    return [*_describe_winners(rows), *describe_inequality(rows)]


def _describe_winners(rows: Sequence[Row]) -> list[str]:
    """Return how cells with means are read, and how many wins make a winner; empty if nothing is random."""
    if not any(row[RANDOM] for row in rows):
        return []
    seeds = len({row[SEED] for row in rows} - {None})
    enough = f"use --seeds {FEWEST_SEEDS} or more."
    if seeds < 2:
        return [f"With random effects, one run shows no winner; {enough}"]
    least = fewest_wins(seeds)
    marked = (
        f"It is marked as the winner with at least {least} wins (two-sided sign test at {100.0 * LEVEL:g} %)."
        if least
        else f"{seeds} seeds are too few to mark a winner; {enough}"
    )
    return [
        f"± is the standard deviation over {seeds} seeds that no tuning used. Every controller has the same "
        "seeds. The lowest mean shows its wins, the seeds with which it is below all others. " + marked
    ]


def describe_inequality(rows: Sequence[Row]) -> list[str]:
    """Return what differs between the controllers beside their gains; empty for equal terms."""
    by_joint: dict[str, list[Row]] = {}
    for row in rows:
        by_joint.setdefault(str(row["joint"]), []).append(row)
    observers, reserves, effort = dict[str, list[str]](), list[str](), list[str]()
    for joint, of_joint in by_joint.items():
        if len({row[OBSERVER] for row in of_joint}) > 1:
            texts = _list({label_variant(row): str(row[OBSERVER]) for row in of_joint})
            observers.setdefault(texts, []).append(joint)
        if len({row[RESERVES] for row in of_joint}) > 1:
            reserves.append(joint)
        if len({(row["scenario"], row["case"]) for row in of_joint}) == 1:
            effort += _describe_effort(joint, group_by_variant(of_joint))
    remarks = [f"observers of {join_names(joints)}: {texts}." for texts, joints in observers.items()]
    if reserves:
        limited = all("%" in part for row in rows for part in str(row[RESERVES]).split(" and "))
        hint = "; --reserves CURRENT,VOLTAGE sets equal ones" if limited else ""
        remarks.append(f"reserves of {join_names(reserves)}, listed below{hint}.")
    return [f"Not equal: {remark}" for remark in (*remarks, *effort)]


def _describe_effort(joint: str, found: Mapping[str, SeedStatistics]) -> Iterator[str]:
    """Return a remark if the winner of the position error needs more torque than others that are held."""
    ranking = rank(found, SHOWN["position_error_m"])
    if ranking is None or not ranking.is_winner or not (effort := found[ranking.best].mean(_EFFORT)):
        return
    ratios = {name: effort / e for name, one in found.items() if one.is_held and (e := one.mean(_EFFORT))}
    more = [f"{name} ({100.0 * (ratio - 1.0):.0f} %)" for name, ratio in ratios.items() if ratio > _MORE]
    if more:
        yield (
            f"{ranking.best} wins the position error of {joint} with more torque effort than "
            f"{join_names(more)}."
        )


def name_observers(rows: Sequence[Row]) -> dict[str, str]:
    """Return the observers of each controller with its gains; if joints differ, the rules without numbers."""
    observers: dict[str, dict[str, None]] = {}
    for row in rows:
        observers.setdefault(label_variant(row), {})[str(row[OBSERVER])] = None
    return {
        name: join_names(dict.fromkeys(text.partition(" ")[0] for text in texts) if len(texts) > 1 else texts)
        for name, texts in observers.items()
    }


def _list(texts: Mapping[str, str]) -> str:
    """Return texts by controller, each text once."""
    by_text: dict[str, list[str]] = {}
    for name, text in texts.items():
        by_text.setdefault(text, []).append(name)
    return "; ".join(f"{join_names(names)} {text}" for text, names in by_text.items())

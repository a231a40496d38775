"""What the joints of a run, or other objects of its metrics, idealise."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..base.errors import join_names
from ..recorders.metrics import IDEALISED
from ..run.result import Result


class IdealisationRow(NamedTuple):
    """What an object idealises, the option that removes it, and the source of typical values."""

    subject: str
    sentence: str
    option: str
    source: str


def list_idealisations(result: Result) -> list[IdealisationRow]:
    """Return all that objects of metrics idealise."""
    return [
        IdealisationRow(subject, entry["sentence"], entry["option"], entry["source"])
        for subject, entries in _list_by_subject(result).items()
        for entry in entries
    ]


def describe_idealisations(result: Result) -> str | None:
    """Return in one line what objects of metrics idealise; None if nothing."""
    subjects, sources = dict[str, list[str]](), dict[str, None]()
    for subject, entries in _list_by_subject(result).items():
        subjects.setdefault(", ".join(entry["label"] for entry in entries), []).append(subject)
        sources |= dict.fromkeys(entry["source"] for entry in entries if entry["source"])
    labels = {text: join_names(names) for text, names in subjects.items() if text}
    if not labels:
        return None
    # joints that idealise the same need no names
    parts = labels if len(subjects) == 1 else [f"{names}: {text}" for text, names in labels.items()]
    values = f"typical values: {', '.join(sources)}; " if sources else ""
    return f"Idealised: {'; '.join(parts)} ({values}metrics.json has the option for each)"


def _list_by_subject(result: Result) -> dict[str, Sequence[Mapping[str, str]]]:
    kinds = result.metrics.values()
    return {of: figures[IDEALISED] for kind in kinds for of, figures in kind.items() if IDEALISED in figures}

"""What an FMU says, and where."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

from ...fmu.instance import OK
from ...fmu.log import Line
from ..check import check
from ..host.afresh import afresh, separately
from ..host.drive import driven
from ..host.experiment import experiment
from ..host.instance import Instance
from ..host.log import LOG, whole
from ..subject import Subject
from ..verdict import Clause, Outcome, failed, passed, warned

_MOST_CATEGORIES = 6
_ALL = "logAll"
"""The category that section 2.2.4 proposes for all messages."""

_STEPS = 10


@check(
    "log.categories",
    "Messages come only when they are asked for",
    Clause("2.1.5", "If loggingOn=fmi2True, debug logging is enabled, otherwise it is switched off."),
    "Look at loggingOn and at the categories before the logger is called with fmi2OK; print nothing.",
    needs=("run.completes",),
    patience=2.0,
)
def categories(subject: Subject) -> Outcome:
    """Debug messages come in the categories that are on, and nothing goes to standard output."""
    declared = [str(e.get("name")) for e in subject.tree.iterfind("LogCategories/Category")]
    alone = [c for c in declared if c != _ALL][:_MOST_CATEGORIES]
    asked = [(False, []), (True, declared), *((True, [category]) for category in alone)]
    (quiet, everything, *apart), printed = afresh(_said, subject, asked)
    for line in quiet:
        if line.status == OK:
            return failed(f"With debug logging off it logs in {_category(line)}: {whole(line.text)}")
    for category, lines in zip(alone, apart, strict=True):
        for line in lines:
            if line.status == OK and line.category != category:
                where = f"With {category} alone switched on it logs in {_category(line)}"
                return failed(f"{where}: {whole(line.text)}")
    strange = sorted({_category(line) for line in [*quiet, *everything] if line.category not in declared})
    if strange and declared:
        return warned(f"It logs in {', '.join(strange)}, which modelDescription.xml does not declare.")
    if printed:
        return warned(f"It writes to standard output: {whole(printed)}")
    return passed(f"{len(everything)} messages came when they were asked for, in {len(declared)} categories.")


def _category(line: Line) -> str:
    return f"category {line.category!r}" if line.category else "no category"


def _said(subject: Subject, asked: Sequence[tuple[bool, list[str]]]) -> tuple[list[list[Line]], str]:
    """Messages of short runs, one for each way to switch logging, and the first line that is printed."""
    with tempfile.TemporaryFile() as stream:
        os.dup2(stream.fileno(), 1)
        found = [separately(_run, subject, logging, names) for logging, names in asked]
        _flush()
        stream.seek(0)
        text = stream.read().decode(errors="replace").strip()
    return found, text.partition("\n")[0]


def _run(subject: Subject, logging: bool, names: list[str]) -> list[Line]:
    LOG.lines.clear()
    instance, course = Instance(subject, logging=logging), experiment(subject, _STEPS)
    with instance.calling():
        instance.fmu.setDebugLogging(logging, names)
    driven(instance, course)
    instance.close()
    return list(LOG.lines)


def _flush() -> None:
    """What C and Python keep for later."""
    if sys.stdout is not None:
        sys.stdout.flush()
    flush: Any = getattr(ctypes.CDLL(None), "fflush", None)
    if flush is not None:
        flush(None)

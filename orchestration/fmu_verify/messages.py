"""Format messages, and judge lists of problems."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from emla_cosim.base.faults import ADVICE

from .check import CheckOutcome, Clause, failed, passed, warned

_ADVICE = re.compile(rf" \({re.escape(ADVICE)}[^)]*\)| {re.escape(ADVICE)}\.")
LONGEST = 400
"""Most characters of a message; names in an FMU can have any length."""
MOST = 50
"""Most lines of details."""


class Breach(NamedTuple):
    """A message, and the clause that is violated if it is not the clause of the check."""

    message: str
    clause: Clause


Problem = str | Breach


def judge_problems(
    problems: Sequence[Problem], fine: str, doubts: Sequence[Problem] = (), gaps: tuple[str, ...] = ()
) -> CheckOutcome:
    """Judge lists of problems: the message is the first one, the details are all of them.

    Args:
        problems: Messages that make the check fail.
        fine: Message if the check passes.
        doubts: Messages that only warn.
        gaps: What the check could not judge.
    """
    lines = [
        (shorten_sentence(problem.message), problem.clause)
        if isinstance(problem, Breach)
        else (shorten_sentence(problem), None)
        for problem in (*problems, *doubts)
    ]
    if not lines:
        return passed(fine, gaps=gaps)
    message, clause = lines[0]
    if more := len(lines) - 1:
        message += " There is one more place." if more == 1 else f" There are {more} more places."
    if len(lines) > MOST:
        lines[MOST:] = [(f"There are {len(lines) - MOST} more.", None)]
    make = failed if problems else warned
    return make(message, lines=tuple(lines) if more else (), clause=clause, gaps=gaps)


def shorten_sentence(text: str) -> str:
    """Return a message as one line. Leave out its middle if it is longer than `LONGEST`."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


def list_left_out(examined: int, total: int, description: str) -> tuple[str, ...]:
    """Return a gap for *Not examined* if not all were done: `Only 3 of 9 Strings were read.`"""
    return (f"Only {examined} of {total} {description}",) if examined < total else ()


def join_few_names(names: Sequence[str], most: int = 5) -> str:
    """Join names with commas, at most `most`, followed by the number of the others."""
    first_names = ", ".join(names[:most])
    return f"{first_names} and {len(names) - most} more" if len(names) > most else first_names


def format_sentence(text: object) -> str:
    """Capitalize the message of an error. Leave out the advice to use an option of other commands."""
    message = _ADVICE.sub("", str(text))
    return message[:1].upper() + message[1:]

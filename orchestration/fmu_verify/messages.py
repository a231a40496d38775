"""Format messages, and judge lists of problems."""

from collections.abc import Sequence
from typing import NamedTuple

from .verdict import CheckOutcome, Clause, failed, passed, warned

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
    for make, found in ((failed, problems), (warned, doubts)):
        if found:
            every = [*problems, *doubts]
            clause = found[0].clause if isinstance(found[0], Breach) else None
            lines = _lines([_line(one) for one in every]) if len(every) > 1 else ()
            first = f"{shorten_sentence(_message(found[0]))}{_and_more(len(every) - 1)}"
            return make(first, lines=lines, clause=clause, gaps=gaps)
    return passed(fine, gaps=gaps)


def _message(problem: Problem) -> str:
    return problem.message if isinstance(problem, Breach) else problem


def _line(problem: Problem) -> tuple[str, Clause | None]:
    """Return the message and its own clause."""
    return shorten_sentence(_message(problem)), problem.clause if isinstance(problem, Breach) else None


def _and_more(count: int) -> str:
    if count == 0:
        return ""
    return " There is one more place." if count == 1 else f" There are {count} more places."


def _lines(found: Sequence[tuple[str, Clause | None]]) -> tuple[tuple[str, Clause | None], ...]:
    rest = ((f"There are {len(found) - MOST} more.", None),) if len(found) > MOST else ()
    return (*found[:MOST], *rest)


def shorten_sentence(text: str) -> str:
    """Return a message as one line. Leave out its middle if it is longer than `LONGEST`."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


def list_left_out(done: int, total: int, what: str) -> tuple[str, ...]:
    """Return a gap for *Not examined* if not all were done: `Only 3 of 9 Strings were read.`"""
    return (f"Only {done} of {total} {what}",) if done < total else ()


def join_few_names(names: Sequence[str], most: int = 5) -> str:
    """Join names with commas, at most `most`, followed by the number of the others."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def sentence(text: object) -> str:
    """Capitalize the message of an error."""
    return str(text)[:1].upper() + str(text)[1:]

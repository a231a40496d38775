"""Verdicts on lists of problems: the first as the sentence, all of them as details."""

from collections.abc import Sequence

from .verdict import CheckOutcome, failed, passed, warned

LONGEST = 400
"""Characters of a sentence; names in a file of strangers can be of any length."""
MOST = 50
"""Lines of details; whoever has more to mend starts with these."""


def judge_problems(problems: Sequence[str], fine: str, doubts: Sequence[str] = ()) -> CheckOutcome:
    """Failed with problems, warned with doubts alone, and otherwise passed with what is fine."""
    for make, found in ((failed, problems), (warned, doubts)):
        if found:
            rest = [*problems, *doubts][1:]
            details = _lines([*problems, *doubts]) if rest else ()
            return make(f"{shorten_sentence(found[0])}{_and_more(len(rest))}", details=details)
    return passed(fine)


def _and_more(count: int) -> str:
    if count == 0:
        return ""
    return " There is one more place." if count == 1 else f" There are {count} more places."


def _lines(found: Sequence[str]) -> tuple[str, ...]:
    rest = (f"There are {len(found) - MOST} more.",) if len(found) > MOST else ()
    return (*(shorten_sentence(line) for line in found[:MOST]), *rest)


def shorten_sentence(text: str) -> str:
    """A sentence in one line, its middle left out where a name in it is endless."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


def join_few_names(names: Sequence[str], most: int = 5) -> str:
    """Names in a row, no more than fit a sentence."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def sentence(text: object) -> str:
    """What an error says, which begins as the rest of a line does, as a sentence of its own."""
    return str(text)[:1].upper() + str(text)[1:]

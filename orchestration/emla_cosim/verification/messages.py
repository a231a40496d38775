"""Format messages, and judge lists of problems."""

from collections.abc import Sequence

from .verdict import CheckOutcome, failed, passed, warned

LONGEST = 400
"""Most characters of a message; names in an FMU can have any length."""
MOST = 50
"""Most lines of details."""


def judge_problems(problems: Sequence[str], fine: str, doubts: Sequence[str] = ()) -> CheckOutcome:
    """Judge lists of problems: the message is the first one, the details are all of them.

    Args:
        problems: Messages that make the check fail.
        fine: Message if the check passes.
        doubts: Messages that only warn.
    """
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
    """Return a message as one line. Leave out its middle if it is longer than `LONGEST`."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


def join_few_names(names: Sequence[str], most: int = 5) -> str:
    """Join names with commas, at most `most`, followed by the number of the others."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def sentence(text: object) -> str:
    """Capitalize the message of an error."""
    return str(text)[:1].upper() + str(text)[1:]

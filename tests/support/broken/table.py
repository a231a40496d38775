"""All FMUs that are broken on purpose, and the table of them in the documentation.

`python -m tests.support.broken.table` writes it.
"""

import re

from fmu_verify.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import DYNAMIC
from tests.support.broken.layered import LAYERED
from tests.support.broken.memory import MEMORY
from tests.support.broken.numeric import NUMERIC
from tests.support.broken.related import RELATED_FILES
from tests.support.broken.static import STATIC
from tests.support.broken.third import CLOCKED, THIRD
from tests.support.broken.wide import WIDE
from tests.support.paths import ROOT

BROKEN: list[Broken] = [
    *(*STATIC, *DYNAMIC, *WIDE, *NUMERIC, *MEMORY, *THIRD, *LAYERED, *CLOCKED, *RELATED_FILES),
]

_BEGIN, _END = "<!-- broken fmus begin -->", "<!-- broken fmus end -->"


def table() -> str:
    """The table, with what stands around it on the page."""
    rows = [f"| {_sentence(b.what)} | `{b.check}` | {_shown(b)} |" for b in BROKEN]
    return "\n".join(
        [_BEGIN, "| What is wrong | Check that says so | Verdict |", "|---|---|---|", *rows, _END]
    )


def _shown(broken: Broken) -> str:
    return "noted" if broken.verdict == Verdict.PASSED else str(broken.verdict)


def _sentence(text: str) -> str:
    return (text[:1].upper() + text[1:]).replace("|", r"\|")


def main() -> None:
    """Write it."""
    page = ROOT / "docs" / "verify.md"
    text = page.read_text(encoding="utf-8")
    found = re.sub(f"{_BEGIN}.*{_END}", lambda _: table(), text, flags=re.DOTALL)
    page.write_text(found, encoding="utf-8")


if __name__ == "__main__":
    main()

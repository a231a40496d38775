"""All FMUs that are broken on purpose, and their list in the documentation.

`python -m tests.support.broken.table` writes it.
"""

import csv
import io

from fmu_verify.check import Verdict
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
    *(*STATIC, *DYNAMIC, *WIDE, *NUMERIC, *MEMORY, *THIRD, *LAYERED, *CLOCKED, *RELATED_FILES)
]
FILE = ROOT / "docs" / "broken-fmus.csv"


def table() -> str:
    """Return the list as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["fault", "check", "verdict"])
    for broken in BROKEN:
        verdict = "noted" if broken.verdict == Verdict.PASSED else str(broken.verdict)
        writer.writerow([broken.what[:1].upper() + broken.what[1:], broken.check, verdict])
    return text.getvalue()


if __name__ == "__main__":
    FILE.write_text(table(), encoding="utf-8", newline="\n")

"""Check the documentation and licence of an FMU."""

from ..check import check
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause


@check(
    "documents.present",
    "The FMU has documentation and a licence",
    Clause(
        "2.3",
        "It is strongly recommended to include all license and copyright related information in the licenses "
        "folder of an FMU",
    ),
    "Write documentation/index.html and documentation/licenses/license.txt.",
    needs=("description.readable",),
)
def present(subject: Subject) -> CheckOutcome:
    """Check that there are a start page and a licence, or the name of one."""
    folder = subject.folder / "documentation"
    doubts = []
    if not (folder / "index.html").is_file():
        others = sorted(p.name for p in folder.glob("*.*") if p.suffix in (".pdf", ".md", ".htm"))
        doubts.append(f"documentation/index.html is missing{f'; there is {others[0]}' if others else ''}.")
    licences = [folder / "licenses" / f"license.{kind}" for kind in ("txt", "html")]
    if not any(p.is_file() for p in licences) and not subject.tree.get("license"):
        doubts.append("The FMU names no licence.")
    return judge_problems((), "The FMU has a start page and a licence.", doubts)

"""Check the documentation and licence of an FMU."""

from ..check import check
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, passed, warned
from .archive import LICENCE_KINDS

_PAGES = (".pdf", ".md", ".htm", ".html", ".txt")
"""How the names of start pages end."""


@check(
    "documents.present",
    "The documentation has a start page",
    Clause(
        "2.3",
        "index.html // Entry point of the documentation",
        in_3=fmi3("2.5.1", "index.html                       // entry point of the documentation"),
    ),
    "Write documentation/index.html, which may only link to the other files.",
    needs=("description.readable",),
)
def present(subject: Subject) -> CheckOutcome:
    """Check that documentation has its start page. Documentation and a licence are optional."""
    folder = subject.folder / "documentation"
    others = sorted(p.name for p in folder.glob("*.*") if p.suffix.lower() in _PAGES)
    has_page = any(name.lower() == "index.html" for name in others)  # `archive.layout` reports the case
    if others and not has_page:
        return warned(f"documentation/index.html is missing; there is {others[0]}.")
    licences = [folder / "licenses" / f"license.{kind}" for kind in LICENCE_KINDS]
    has_licence = any(p.is_file() for p in licences) or bool(subject.tree.get("license"))
    page = "It has a start page." if has_page else "It has no documentation, which is optional."
    licence = "It has a licence." if has_licence else "It names no licence, which is only recommended."
    return passed(f"{page} {licence}")

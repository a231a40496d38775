"""Insert the table of checks, generated from the catalogue."""

from collections.abc import Iterator

from fmu_verify.catalogue import CHECKS

PLACE = "<!-- table of checks -->"


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the placeholder by the table."""
    return markdown.replace(PLACE, "\n".join(_lines())) if PLACE in markdown else markdown


def _lines() -> Iterator[str]:
    yield "| Check | What it asks | Rests on |\n|---|---|---|"
    for check in CHECKS:
        versions = [version for version in (2, 3) if check.only_for in (0, version)]
        clauses = dict.fromkeys(str(check.of(version).clause) for version in versions)
        yield f"| `{check.name}` | {check.title} | {'; '.join(clauses)} |"

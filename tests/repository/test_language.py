"""The documentation follows the rules for plain technical English; see `support.language`."""

import json
from pathlib import Path

import pytest

from tests.support.language import LONGEST, check_page, passages
from tests.support.paths import ROOT

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "fmus").glob("*/README.md")),
    *(ROOT / name for name in ("benchmarks/README.md", "modelica/README.md")),
    *sorted((ROOT / "tests").glob("*.md")),
]
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_plain_english(page: Path) -> None:
    faults = check_page(page.read_text(encoding="utf-8"), str(page.relative_to(ROOT)))
    assert not faults, "\n" + "\n".join(faults)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_is_plain_english(notebook: Path) -> None:
    name = str(notebook.relative_to(ROOT))
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    first, *further = [(i, "".join(c["source"])) for i, c in enumerate(cells) if c["cell_type"] == "markdown"]
    faults = check_page(first[1], f"{name}, cell {first[0]}")
    for i, text in further:
        faults += check_page(f"# Title\n\nFirst.\n\n{text}", f"{name}, cell {i}")
    assert not faults, "\n" + "\n".join(faults)


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("sizing", "actuator.md"),
        ("Simulink", "export.md"),
        ("CSV", "inputs.md"),
        ("own controller", "own-controller.md"),
        ("cluster", "clusters.md"),
        ("checkpoint", "files.md"),
        ("unit", "info.md"),
    ],
)
def test_a_search_word_is_in_a_heading_or_the_first_paragraph(word: str, page: str) -> None:
    """The search of the site ranks headings first."""
    parts = list(passages((ROOT / "docs" / page).read_text(encoding="utf-8")))
    first = next(p.text for p in parts if p.kind == "paragraph")
    headings = [p.text for p in parts if p.kind in {"title", "heading"}]
    assert word.lower() in " ".join([first, *headings]).lower()


LONG = "This text " + "word " * LONGEST + "ends here."
"""Too long by four words."""


@pytest.mark.parametrize(
    ("page", "faults"),
    [
        ("# A\n\nYou can read.\n\nNobody\nis told.\n", ["p.md:5: 'Nobody'", "p.md:6: 'is told'"]),
        (
            "# A\n\nYou can read.\n\n| whoever |\n|---|\n\n## Nobody\n",
            ["p.md:5: 'whoever'", "p.md:8: 'Nobody'"],
        ),
        (f"# A\n\nYou can read FMI 2.0. {LONG}\n\n1. {LONG}\n", ["p.md:3: 39 words", "p.md:5: 39 words"]),
        ("# A\n\n- You can read.\n", ["p.md:3: begin with a paragraph"]),
    ],
)
def test_faults_of_a_page_are_found(page: str, faults: list[str]) -> None:
    messages = check_page(page, "p.md")
    assert len(messages) == len(faults)
    assert all(text.startswith(start) for text, start in zip(messages, faults, strict=True))

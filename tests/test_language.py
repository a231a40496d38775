"""The documentation follows the rules for plain technical English; see `support.language`."""

import json
from collections.abc import Iterator

import pytest

from tests.support.language import check_page, check_text
from tests.support.paths import ROOT

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "fmus").glob("*/README.md")),
    *(ROOT / name for name in ("benchmarks/README.md", "modelica/README.md")),
]
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_plain_english(page) -> None:
    faults = check_page(page.read_text(encoding="utf-8"), str(page.relative_to(ROOT)))
    assert not faults, "\n" + "\n".join(faults)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda page: page.stem)
def test_a_notebook_is_plain_english(notebook) -> None:
    name = str(notebook.relative_to(ROOT))
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    texts = [(i, "".join(c["source"])) for i, c in enumerate(cells) if c["cell_type"] == "markdown"]
    faults = check_page(texts[0][1], f"{name}, cell {texts[0][0]}")
    for i, text in texts[1:]:
        faults += check_text(text, f"{name}, cell {i}")
    assert not faults, "\n" + "\n".join(faults)


def count(text: str) -> Iterator[str]: ...

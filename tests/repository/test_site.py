"""The documentation as a site: built strictly, complete, with nothing loaded from other sites."""

import ast
import sys
from pathlib import Path

import pytest
from lxml import html

import fmublock
from emla_cosim.run.options import list_options
from tests.support.paths import ROOT
from tests.support.processes import run

pytest.importorskip("mkdocs", reason="The extra 'docs' is not installed.")
nbformat = pytest.importorskip("nbformat", reason="The extra 'docs' is not installed.")

pytestmark = pytest.mark.slow

CONFIGURATION = "docs/site/mkdocs.yml"
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
FETCHED = "//script/@src | //link[@rel!='canonical']/@href | //img/@src | //iframe/@src | //source/@src"
"""What a browser fetches by itself."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site; its notebooks were executed."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", CONFIGURATION, "-d", folder]
    process = run(*command, cwd=ROOT, environment={"NO_MKDOCS_2_WARNING": "1"})
    assert process.returncode == 0, process.stderr
    return folder


def page(site: Path, name: str) -> html.HtmlElement:
    return html.parse(str(site / name)).getroot()


def of_stub(text: str) -> set[str]:
    """Names that a stub imports for its users: `from .x import y as y`."""
    imports = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)]
    return {alias.asname for node in imports for alias in node.names if alias.asname == alias.name}


@pytest.mark.parametrize(
    ("module", "names"),
    [
        ("emla_cosim", of_stub((ROOT / "orchestration/emla_cosim/__init__.pyi").read_text())),
        ("fmublock", {*fmublock.__all__, *of_stub(Path(str(fmublock.__file__)).read_text())}),
    ],
)
def test_every_public_name_is_in_the_reference(site: Path, module: str, names: set[str]) -> None:
    assert len(names) > 30
    documented = {}
    for entry in page(site, f"api/{module}.html").xpath("//div[contains(@class, 'doc-object')]"):
        (heading, *_) = entry.xpath("./*[@id]/@id")
        paragraphs = entry.xpath("./div[contains(@class, 'doc-contents')]/p[1]")
        documented[heading.rpartition(".")[2]] = paragraphs[0].text_content() if paragraphs else ""
    assert names <= set(documented)
    assert [n for n in sorted(names) if len(documented[n]) < 10] == []


def test_every_option_is_in_the_table(site: Path) -> None:
    words = page(site, "command-line.html").xpath("//td[1]/code/text()")
    flags = {word.split()[0].rstrip(",") for word in words}
    assert {option.flag for option in list_options().values()} <= flags


def test_pages_load_nothing_from_other_sites(site: Path) -> None:
    pages = [p.relative_to(site) for p in site.rglob("*.html")]
    assert len(pages) > 20
    for name in pages:
        addresses = page(site, str(name)).xpath(FETCHED)
        assert addresses
        assert [x for x in addresses if x.startswith(("http:", "https:", "//"))] == [], name


def test_equations_are_typeset(site: Path) -> None:
    plant = page(site, "fmus/EmlaPlant.html")
    formulas = plant.xpath("//*[local-name() = 'svg'][@role = 'img']")
    assert len(formulas) > 30
    assert any(r"\dot{x}_1" in formula.get("aria-label") for formula in formulas)
    assert all(formula.xpath(".//*[local-name() = 'path']") for formula in formulas)
    assert not plant.xpath("//*[@class = 'arithmatex']")


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_its_results(site: Path, notebook: Path) -> None:
    content = page(site, f"notebooks/{notebook.stem}.html")
    pictures = content.xpath("//article//img/@src")
    assert pictures
    assert all((site / "notebooks" / picture).stat().st_size > 10_000 for picture in pictures)
    assert "Traceback" not in content.text_content()


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_without_outputs(notebook: Path) -> None:
    read = nbformat.read(notebook, as_version=4)
    nbformat.validate(read)
    code = [cell for cell in read.cells if cell.cell_type == "code"]
    assert len(code) > 5
    assert [cell.source for cell in code if cell.outputs or cell.execution_count] == []

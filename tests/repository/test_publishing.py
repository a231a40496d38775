"""Files that other places read: containers, conda, Zenodo, Read the Docs, forms, the FMI site, a journal."""

import json
import re
import shutil
import sys
import tomllib
import zipfile
from fnmatch import fnmatch
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import jsonschema
import pytest
import yaml
from click.testing import CliRunner

from tests.support.language import check_page
from tests.support.paths import ROOT
from tests.support.processes import run
from tests.support.tiers import mostly_slow

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
DOCKER = ROOT / "packaging/docker"
RECIPE = ROOT / "packaging/conda/recipe.yaml"
TOOLS = ROOT / "packaging/fmi-tools"
PAPER = ROOT / "paper/paper.md"
PAGES = (".github/SECURITY.md", ".github/CODE_OF_CONDUCT.md", "packaging/fmi-tools/README.md")


def program(name: str) -> str:
    """The path of a program that a package of the extra 'test' or of Debian has; a skip without it."""
    path = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if path is None:
        pytest.skip(f"There is no {name}.")
    return path


SCHEMA_OF_CITATIONS = ("citation-file-format", ["CITATION.cff"])


@pytest.mark.parametrize(
    ("schema", "files"),
    mostly_slow(
        [
            SCHEMA_OF_CITATIONS,
            ("readthedocs", [".readthedocs.yaml"]),
            ("github-issue-config", [".github/ISSUE_TEMPLATE/config.yml"]),
            (
                "github-issue-forms",
                [f".github/ISSUE_TEMPLATE/{name}.yml" for name in ("bug", "fmu", "result")],
            ),
            ("github-actions", ["action.yml"]),
            ("github-workflows", sorted(str(p) for p in (ROOT / ".github/workflows").iterdir())),
        ],
        [SCHEMA_OF_CITATIONS],
    ),
)
def test_configurations_fit_their_schemas(schema: str, files: list[str]) -> None:
    checker = pytest.importorskip("check_jsonschema", reason="The extra 'test' is not installed.")
    result = CliRunner().invoke(checker.main, ["--builtin-schema", f"vendor.{schema}", *files])
    assert result.exit_code == 0, result.output


@pytest.mark.slow
def test_component_fits_the_schema_of_gitlab(tmp_path: Path) -> None:
    """In two files, because the checker reads one document."""
    documents = (ROOT / "templates/verify-fmus.yml").read_text(encoding="utf-8").split("\n---\n")
    files = [tmp_path / f"{number}.yml" for number in range(len(documents))]
    for file, text in zip(files, documents, strict=True):
        file.write_text(text, encoding="utf-8")
    assert len(files) == 2
    test_configurations_fit_their_schemas("gitlab-ci", [str(file) for file in files])


def test_dockerfile_follows_the_rules_of_hadolint() -> None:
    process = run(program("hadolint"), "--no-color", DOCKER / "Dockerfile")
    assert process.returncode == 0, process.stdout


def test_extras_exist_that_files_install() -> None:
    texts = [(DOCKER / "Dockerfile").read_text(), (ROOT / ".devcontainer/devcontainer.json").read_text()]
    installed = [
        extra
        for text in texts
        for names in re.findall(r"\[([\w,]+)\]['\"]", text)
        for extra in names.split(",")
    ]
    (site,) = yaml.safe_load((ROOT / ".readthedocs.yaml").read_text())["python"]["install"]
    assert {*installed, *site["extra_requirements"]} <= set(PROJECT["optional-dependencies"])
    assert {"plots", "test"} <= set(installed)


@pytest.mark.slow
def test_wheel_can_be_built_from_what_the_container_gets(tmp_path: Path) -> None:
    pytest.importorskip("hatchling", reason="The extra 'test' is not installed.")
    lines = (DOCKER / "Dockerfile.dockerignore").read_text().splitlines()
    sources = [line.removeprefix("!") for line in lines if line.startswith("!")]
    unwanted = [line.removeprefix("**/") for line in lines if line.startswith("**/")]
    for path in (path for pattern in sources for path in ROOT.glob(pattern)):
        target = tmp_path / path.relative_to(ROOT)
        if path.is_dir():
            shutil.copytree(path, target, ignore=shutil.ignore_patterns(*unwanted))
        else:
            target.parent.mkdir(exist_ok=True)
            shutil.copy(path, target)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path / "wheels"]
    run(*command, cwd=tmp_path, check=True)
    (wheel,) = (tmp_path / "wheels").iterdir()
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    for needed in (
        "emla_cosim/documents/LICENSE",
        "emla_cosim/documents/fmus/EmlaPlant/README.md",
        "emla_cosim/cli/program.py",
    ):
        assert needed in names
    assert any(fnmatch(name, "*.dist-info/licenses/*schemas/LICENSE") for name in names)


ENTRY = {
    "type": "object",
    "required": ["name", "license", "url", "vendor", "vendorURL", "description", "features", "platforms"],
    "additionalProperties": False,
    "properties": {
        **{name: {"type": "string", "minLength": 1} for name in ("name", "vendor")},
        **{name: {"type": "string", "pattern": "^https://"} for name in ("url", "vendorURL", "examplesURL")},
        "license": {"enum": ["commercial", "osi"]},
        "description": {"type": "string", "pattern": r"^[^<>\[\]]*[^.]$"},  # no markup, no dot at the end
        "features": {"const": []},
        **{
            name: {"type": "array", "uniqueItems": True, "items": {"enum": values}}
            for name, values in {
                "platforms": ["macOS", "Linux", "Windows", "Source Code"],
                "interfaces": ["GUI", "CLI", "library"],
                "fmiVersions": ["1.0", "2.0", "3.0"],
                "fmuExport": ["CS", "ME", "SE"],
                "fmuImport": ["CS", "ME", "SE"],
                "layeredStandards": ["BUS", "REF", "STRUCT", "XCP"],
            }.items()
        },
    },
}
"""An entry of the list of tools, as the contribution guide of the FMI site describes it."""

DEPOSIT = {
    "type": "object",
    "required": ["title", "upload_type", "description", "creators", "access_right", "license"],
    "additionalProperties": False,
    "properties": {
        **{name: {"type": "string", "minLength": 1} for name in ("title", "description", "license", "notes")},
        "upload_type": {"const": "software"},
        "access_right": {"const": "open"},
        "language": {"type": "string", "pattern": "^[a-z]{3}$"},
        "creators": {
            "type": "array",
            "minItems": 1,
            "items": {
                "type": "object",
                "required": ["name"],
                "additionalProperties": False,
                "properties": {name: {"type": "string"} for name in ("name", "affiliation", "orcid")},
            },
        },
        "keywords": {"type": "array", "items": {"type": "string"}},
    },
}
"""The part of Zenodo's metadata of a deposit that the project uses."""


@pytest.mark.parametrize(
    ("file", "schema"),
    [
        ("packaging/fmi-tools/emla-cosim.json", ENTRY),
        (".zenodo.json", DEPOSIT),
    ],
)
def test_files_without_a_checker_fit_the_schemas_here(file: str, schema: dict[str, Any]) -> None:
    jsonschema.validate(json.loads((ROOT / file).read_text(encoding="utf-8")), schema)


def test_zenodo_and_citation_agree() -> None:
    deposit = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert deposit["title"] == CITATION["title"]
    assert deposit["keywords"] == CITATION["keywords"]
    assert deposit["description"].split() == CITATION["abstract"].split()
    assert [creator["name"] for creator in deposit["creators"]] == [a["name"] for a in CITATION["authors"]]
    assert deposit["license"] in CITATION["license"]
    assert all(
        licence in deposit["notes"] for licence in CITATION["license"] if licence != deposit["license"]
    )


def test_conda_recipe_requires_what_the_base_requires() -> None:
    recipe = yaml.safe_load(RECIPE.read_text(encoding="utf-8"))
    python, *packages = recipe["requirements"]["run"]
    on_conda = {"lief": "py-lief"}
    names = [re.match(r"([\w-]+)(.*)", requirement) for requirement in PROJECT["dependencies"]]
    assert sorted(packages) == sorted(f"{on_conda.get(m[1], m[1])} {m[2]}" for m in names if m)
    assert PROJECT["requires-python"] == python.partition(" ")[2].replace(
        "${{ python_min }}", recipe["context"]["python_min"]
    )
    assert recipe["context"]["version"] == PROJECT["version"]
    (entry,) = (f"{name} = {function}" for name, function in PROJECT["scripts"].items())
    assert recipe["build"]["python"]["entry_points"] == [entry]
    assert recipe["about"]["license"] == PROJECT["license"]


def test_conda_recipe_can_be_rendered() -> None:
    rattler = pytest.importorskip("rattler_build", reason="The extra 'test' is not installed.")
    (variant,) = rattler.Stage0Recipe.from_file(str(RECIPE)).render(rattler.VariantConfig())
    rendered = variant.recipe.to_dict()
    wheel, licence = (RECIPE.parent / source["path"] for source in rendered["source"])
    assert licence.resolve() == ROOT / "LICENSE"
    assert wheel.resolve().parent == ROOT / "build/release"  # of .ci/release.py
    version = rendered["package"]["version"]
    assert wheel.name == f"emla_cosim-{version}-py3-none-any.whl"
    assert rendered["build"]["noarch"] == "python"


@pytest.fixture(scope="module")
def collect() -> ModuleType:
    """The script that makes the example files for the FMI site."""
    specification = spec_from_file_location("collect", TOOLS / "collect.py")
    assert specification and specification.loader
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_example_files_for_the_fmi_site(collect: ModuleType, tmp_path: Path) -> None:
    """Names in quotes and at most ten signals, as the site demands; numbers and options unchanged."""
    source = ROOT / "fmus/EmlaPlant"
    archive = tmp_path / "emla-fmus-1.zip"
    with zipfile.ZipFile(archive, "w") as stream:
        for name in ("EmlaPlant.fmu", "python/EmlaPlant.fmu"):
            stream.writestr(f"emla-fmus-1/EmlaPlant/{name}", name)
        for file in (f for f in source.iterdir() if f.is_file() and f.suffix != ".fmu"):
            stream.write(file, f"emla-fmus-1/EmlaPlant/{file.name}")
        stream.writestr("emla-fmus-1/README.md", "")
    collect.main(archive, tmp_path / "made")
    (folder,) = (tmp_path / "made").iterdir()
    tables = ["EmlaPlant_in.csv", "EmlaPlant_ref.csv"]
    expected = ["EmlaPlant.fmu", *tables, "EmlaPlant_ref.opt", "EmlaPlant_ref.toml", "Readme.txt"]
    assert sorted(f.name for f in folder.iterdir()) == expected
    assert (folder / "EmlaPlant.fmu").read_text() == "EmlaPlant.fmu"
    for name in ("EmlaPlant_ref.opt", "EmlaPlant_ref.toml"):
        assert (folder / name).read_bytes() == (source / name).read_bytes()
    assert "start values in EmlaPlant_ref.toml" in (folder / "Readme.txt").read_text(encoding="utf-8")
    for table, width in (("EmlaPlant_in.csv", None), ("EmlaPlant_ref.csv", 11)):
        written = (folder / table).read_text().splitlines()
        original = (source / table).read_text().splitlines()
        assert written[0] == ",".join(f'"{name}"' for name in original[0].split(",")[:width])
        assert written[1:] == [",".join(row.split(",")[:width]) for row in original[1:]]
        assert (folder / table).stat().st_size < 1e6


def test_text_of_the_paper_has_the_form_of_the_journal() -> None:
    _, header, text = PAPER.read_text(encoding="utf-8").split("---\n", 2)
    metadata = yaml.safe_load(header)
    assert [author["name"] for author in metadata["authors"]] == [a["name"] for a in CITATION["authors"]]
    assert {str(a["affiliation"]) for a in metadata["authors"]} == {
        str(a["index"]) for a in metadata["affiliations"]
    }
    assert 750 <= len(text.split()) <= 1750
    assert re.findall(r"^# (.+)$", text, re.MULTILINE) == [
        *(
            "Summary",
            "Statement of need",
            "State of the field",
            "Software design",
            "Research impact statement",
        ),
        *("AI usage disclosure", "Acknowledgements", "References"),
    ]
    faults = check_page(text.replace("# Summary", "# Title", 1), "paper.md")
    assert not faults, "\n" + "\n".join(faults)


def test_figures_of_the_paper_are_those_of_the_benchmark() -> None:
    text = " ".join(PAPER.read_text(encoding="utf-8").split())
    table = (ROOT / "benchmarks/README.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in table.splitlines()
        if line.startswith("|")
    ]
    ratios = {row[0].split("(")[0].strip(" ,"): row[3] for row in rows if len(row) == 5}
    for words in (
        f"EMLA-Cosim steps at {ratios['EMLA-Cosim']}, Ecos at {ratios['Ecos']}",
        f"libcosim at {ratios['libcosim']}",
        f"FMPy calls at {ratios['FMPy, a loop of its calls']} and CoFmuPy at {ratios['CoFMPy']}",
    ):
        assert words in text


def test_bibliography_has_what_the_paper_cites() -> None:
    bibtexparser = pytest.importorskip("bibtexparser", reason="The extra 'test' is not installed.")
    library = bibtexparser.parse_file(str(PAPER.with_name("paper.bib")))
    assert library.failed_blocks == []
    cited = set(re.findall(r"@(\w+)", PAPER.read_text(encoding="utf-8")))
    assert {entry.key for entry in library.entries} == cited
    for entry in library.entries:
        assert {"title", "author"} <= set(entry.fields_dict), entry.key


@pytest.mark.slow
def test_pandoc_resolves_all_citations(tmp_path: Path) -> None:
    page = tmp_path / "paper.html"
    options = ("--citeproc", "--fail-if-warnings", "-s", "-M", "lang=en", "-o", page)
    process = run(program("pandoc"), *options, PAPER.name, cwd=PAPER.parent)
    assert process.returncode == 0, process.stderr
    assert "???" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_plain_english(page: str) -> None:
    faults = check_page((ROOT / page).read_text(encoding="utf-8"), page)
    assert not faults, "\n" + "\n".join(faults)

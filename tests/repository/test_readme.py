"""README, ARCHITECTURE and CONTRIBUTING: short, and what they name exists."""

import re
import tomllib

import pytest

from emla_cosim.fmu.models import MODELS
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.study.loading import load
from tests.support.pages import fences
from tests.support.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
MODEL_LIST = (ROOT / "docs/models.md").read_text(encoding="utf-8")


def test_the_readme_is_short() -> None:
    lines = README.splitlines()
    assert len(lines) <= 120
    assert sum(line.startswith("```sh") for line in lines[:30]) == 2
    assert sum(line.startswith("![") for line in lines[:30]) == 1


def test_the_start_page_names_every_page() -> None:
    """So that a reader without the site's navigation gets everywhere."""
    start = ROOT / "docs/index.md"
    linked = set(re.findall(r"\]\(([\w.-]+\.md)", start.read_text(encoding="utf-8")))
    assert linked == {page.name for page in ROOT.glob("docs/*.md")} - {start.name}


def test_every_command_of_the_readme_is_executed() -> None:
    """By the test of pages, but for those that set up an environment, which `.ci/run` executes."""
    blocks = [f for f in fences(README) if re.search(r"\bemla (?!cosim)", f.content)]
    left_out = [f for f in blocks if (f.language, f.info) != ("sh", "")]
    assert len(blocks) > len(left_out)
    assert [f.content for f in left_out if "bin/emla run study" not in f.content] == []


def test_every_model_and_scenario_named_exists() -> None:
    for name in re.findall(r"`emla run ([a-z-]+)`", README):
        load(name)
    assert set(re.findall(r"\[(\w+)\]\(../fmus/\w+/README.md\)", MODEL_LIST)) <= set(MODELS)
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", README):
        assert (ROOT / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_every_named_file_exists(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    package = ROOT / "orchestration/emla_cosim"
    above = (package / "analyses", package, package.parent, ROOT)
    homes = {path.name: path for folder in above for path in folder.iterdir()}
    names = [n for n in re.findall(r"`(\w+)/([^`* ]*)`", text) if n[0] in homes or n[1].endswith(".py")]
    assert len(names) > 15
    for first, rest in names:
        path = homes.get(first, ROOT / first) / rest.replace("NAME", "EmlaPlant")
        assert path.exists(), f"{first}/{rest}"


def test_every_room_is_in_contract_and_architecture() -> None:
    """Import-linter checks only rooms that its contract lists."""
    package = ROOT / "orchestration/emla_cosim"
    rooms = {path.stem for path in package.iterdir() if path.is_dir() or path.suffix == ".py"}
    rooms -= {"__init__", "__pycache__"}
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    floors = " ".join(contracts["contracts"][0]["layers"])
    assert {name.removeprefix("emla_cosim.") for name in re.findall(r"emla_cosim\.\w+", floors)} == rooms
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    assert {name for name in rooms if not re.search(rf"^\| .*`{name}(/|\.py)`", text, re.MULTILINE)} == {
        "__main__"
    }


def test_gain_sets_of_scenarios_are_those_of_the_page() -> None:
    page = (ROOT / "docs/systems.md").read_text(encoding="utf-8")
    start = page.index("| Scenario | Content | Gain set |")
    table = page[start : page.index("\n\n", start)]
    documented = {}
    for row in table.splitlines()[2:]:
        _, names, _, gains, *_ = row.split("|") if row.startswith("|") else ("", "", "", "")
        documented |= {name: gains.strip(" `") for name in re.findall(r"`([\w-]+)`", names)}
    assert documented == {name: load(name).options.gains for name in SCENARIOS}

"""The action, the workflow and the component that other repositories use: steps as a runner does them, and
what linters find."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from fmu_verify.pipeline import CODE_QUALITY, REPORTS
from tests.support.pages import fences
from tests.support.paths import ROOT
from tests.support.pipelines import cut_fmu, good_fmu, strayed_fmu
from tests.support.processes import run

FOLDER = ROOT / ".github" / "workflows"
WORKFLOWS = pytest.mark.parametrize("file", sorted(FOLDER.glob("*.yml")), ids=lambda file: file.stem)
FILE = FOLDER / "verify-fmus.yml"
WORKFLOW = yaml.safe_load(FILE.read_text(encoding="utf-8"))
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS = ACTION["runs"]["steps"]
INPUTS = ACTION["inputs"]
SPEC, COMPONENT = yaml.safe_load_all((ROOT / "templates/verify-fmus.yml").read_text(encoding="utf-8"))
COMPONENT_INPUTS = SPEC["spec"]["inputs"]
PROGRAMS = Path(sys.executable).parent
FEW = "archive\nrun\nreference"
"""The checks of most tests: few, for speed."""

CALLERS = [
    fence.content
    for fence in fences((ROOT / "docs" / "verify-in-ci.md").read_text(encoding="utf-8"))
    if "jobs:" in fence.content
]
LOCAL_PATHS = {
    "OWNER/emla-cosim/.github/workflows/verify-fmus.yml@main": "./.github/workflows/verify-fmus.yml",
    "OWNER/emla-cosim@main": "./.emla-verify",
}
"""Where the files are that callers name, in the folder in which they are linted."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="The workflow runs on Linux."),
]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT, check=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def runner(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a runner, where pip installs the wheel alone; the rest is here already."""
    folder = tmp_path_factory.mktemp("runner")
    return {
        "PATH": os.pathsep.join([str(folder / "site" / "bin"), str(PROGRAMS), os.environ["PATH"]]),
        "PYTHONPATH": str(folder / "site"),
        "PIP_TARGET": str(folder / "site"),
        "PIP_NO_DEPS": "1",
        "PIP_NO_INDEX": "1",
        "PIP_UPGRADE": "1",
        "WHEEL": str(wheel),
    }


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    (tmp_path / "temp").mkdir()
    (tmp_path / "workspace").mkdir()
    return tmp_path / "workspace"


@dataclass
class Ended:
    """How the steps of a job ended: the name of the step that failed, and its exit code."""

    failed: str = ""
    code: int = 0
    output: str = ""
    steps: list[str] = field(default_factory=list)


def verified(workspace: Path, runner: dict[str, str], **inputs: str) -> Ended:
    """Do all `run` steps in the workspace; what they leave is in the folder beside it.

    As a runner does: after one that fails only those that say so are done. Steps that use other people's
    actions are left out.
    """
    input_values = {name: str(about.get("default", "")) for name, about in INPUTS.items()}
    input_values |= {"emla": runner["WHEEL"], "only": FEW}
    input_values |= {name.replace("_", "-"): value for name, value in inputs.items()}
    folders = {
        "GITHUB_ACTIONS": "true",
        "GITHUB_ACTION_PATH": str(ROOT),
        "GITHUB_OUTPUT": str(workspace.parent / "output"),
        "RUNNER_TEMP": str(workspace.parent / "temp"),
        "GITHUB_STEP_SUMMARY": str(workspace.parent / "summary.md"),
    }
    ended = Ended()
    for step in STEPS:
        if "run" not in step or (ended.failed and "!cancelled()" not in step.get("if", "")):
            continue
        step_variables = {
            name: re.sub(r"\$\{\{ inputs\.([\w-]+) \}\}", lambda m: input_values[m[1]], text)
            for name, text in step.get("env", {}).items()
        }
        shell = ("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"])
        process = run(*shell, cwd=workspace, environment=runner | folders | step_variables)
        ended.output += process.stdout + process.stderr
        ended.steps.append(step["name"])
        if process.returncode and not ended.failed:
            ended.failed, ended.code = step["name"], process.returncode
    return ended


def verdicts(workspace: Path) -> dict[str, str]:
    """Of all checks of the only FMU, from the report."""
    report = json.loads((workspace.parent / "temp/fmu-report/report.json").read_text(encoding="utf-8"))
    (examined,) = report["examined"]
    return {finding["check"]: finding["verdict"] for finding in examined["findings"]}


def read_summary(workspace: Path) -> str:
    return (workspace.parent / "summary.md").read_text(encoding="utf-8")


def test_good_fmus_pass(workspace: Path, runner: dict[str, str], fmu_folder: Path) -> None:
    good_fmu(workspace / "build" / "deep er", fmu_folder)
    ended = verified(workspace, runner, fmus="build/**/*.fmu\n")
    assert (ended.failed, ended.code) == ("", 0), ended.output
    assert ended.steps == ["Install", "Verify"]
    reports = workspace.parent / "temp/fmu-report"
    assert (workspace.parent / "output").read_text() == f"folder={reports}\n"
    assert {file.name for file in reports.iterdir()} == {*REPORTS.values(), CODE_QUALITY}
    assert verdicts(workspace)["reference.agrees"] == "passed"
    suites = ElementTree.parse(workspace.parent / "temp/fmu-report/junit.xml").getroot()
    assert suites.attrib["failures"] == "0" and int(suites.attrib["tests"]) > 4
    assert "</html>" in (workspace.parent / "temp/fmu-report/report.html").read_text(encoding="utf-8")
    summary = read_summary(workspace)
    assert "✅ FMUs passed" in summary and "| ✅ | build/deep er/Reference.fmu |" in summary
    which = "head -1 \"$(command -v emla)\" && python -c 'import emla_cosim; print(emla_cosim.__file__)'"
    assert runner["PIP_TARGET"] in run("bash", "-c", which, environment=runner).stdout  # that of the wheel


def test_failed_check_fails_the_job_and_is_reported(
    workspace: Path, runner: dict[str, str], fmu_folder: Path
) -> None:
    strayed_fmu(workspace / "build", fmu_folder)
    cut_fmu(workspace / "build")
    ended = verified(workspace, runner, fmus="build/Reference.fmu\nbuild/C*.fmu")
    assert (ended.failed, ended.code) == ("Verify", 1), ended.output
    summary = read_summary(workspace)
    assert "❌ build/Cut.fmu: **archive.safe**" in summary
    assert "❌ build/Reference.fmu: **reference.agrees**" in summary
    entries = json.loads((workspace.parent / "temp/fmu-report" / CODE_QUALITY).read_text())
    assert {(entry["location"]["path"], entry["check_name"], entry["severity"]) for entry in entries} >= {
        ("build/Cut.fmu", "archive.safe", "major"),
        ("build/Reference.fmu", "reference.agrees", "major"),
    }


def test_inputs_become_options(workspace: Path, runner: dict[str, str], fmu_folder: Path) -> None:
    strayed_fmu(workspace / "kept", fmu_folder)
    (workspace / "build").mkdir()
    shutil.move(workspace / "kept" / "Reference.fmu", workspace / "build")
    files = {"fmus": "build/*.fmu", "only": "run.[cf]*[es]\nreference\n", "skip": "run.finite"}
    assert verified(workspace, runner, **files, reference="kept").code == 1
    assert verdicts(workspace) == {"run.completes": "passed", "reference.agrees": "failed"}
    wide = verified(workspace, runner, **files, reference="kept", tolerance="x=1\n*=relative:1e30\n")
    assert wide.code == 0, wide.output


@pytest.mark.parametrize(
    ("names", "step"), [(["emla"], "Install"), (["fmus", "reference", "only", "skip", "tolerance"], "Verify")]
)
def test_inputs_are_not_executed(
    names: list[str], step: str, workspace: Path, runner: dict[str, str], tmp_path: Path
) -> None:
    """With all in them that a shell would act on, the step fails as a wrong command does, and that is all."""
    trap = f"'\"; touch {tmp_path}/ran; $(touch {tmp_path}/ran) `touch {tmp_path}/ran` --help $HOME \\"
    ended = verified(workspace, runner, **({"fmus": "*.fmu"} | dict.fromkeys(names, trap)))
    assert (ended.failed, ended.code in (1, 2)) == (step, True), ended.output
    assert "$HOME" in ended.output
    assert not (tmp_path / "ran").exists()


def test_odd_file_names(workspace: Path, runner: dict[str, str], fmu_folder: Path) -> None:
    odd = workspace / "--help $(exit 3) 'it' & | <b>.fmu"
    good_fmu(workspace, fmu_folder).rename(odd)
    assert verified(workspace, runner, fmus="*.fmu").code == 0
    summary = read_summary(workspace)
    assert "<b>" not in summary and "&lt;b&gt;" in summary and "& | " not in summary


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        (
            "none/*.fmu",
            "::error title=FMUs were not verified::The input fmus has 'none/*.fmu'",
        ),
        ("x.fmu", "'x.fmu', which matches no file."),
        ("\n", "The input fmus is empty."),
    ],
)
def test_missing_fmus_fail(pattern: str, words: str, workspace: Path, runner: dict[str, str]) -> None:
    ended = verified(workspace, runner, fmus=pattern)
    assert (ended.failed, ended.code) == ("Verify", 2)
    assert words in ended.output
    assert not (workspace.parent / "summary.md").exists()


@WORKFLOWS
def test_scripts_have_no_expressions_and_jobs_read_only(file: Path) -> None:
    workflow = yaml.safe_load(file.read_text(encoding="utf-8"))
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    assert [step["name"] for step in steps if "${{" in step.get("run", "")] == []
    assert workflow["permissions"] == {"contents": "read"}
    writing = {name for name, job in workflow["jobs"].items() if "permissions" in job}
    assert writing == ({"publish", "pypi"} if file.stem == "release" else set())
    assert all("timeout-minutes" in job for job in workflow["jobs"].values())


def test_component_runs_the_same_step(workspace: Path, runner: dict[str, str], fmu_folder: Path) -> None:
    """Its script in a shell, with the variables that GitLab would set."""
    strayed_fmu(workspace / "build", fmu_folder)
    defaults = {name: about.get("default", "") for name, about in COMPONENT_INPUTS.items()}
    input_values = defaults | {"fmus": "build/**/*.fmu", "emla": runner["WHEEL"], "only": FEW}
    (job,) = COMPONENT.values()
    variables = {
        name: re.sub(r"\$\[\[ inputs\.([\w-]+) \]\]", lambda m: input_values[m[1]], variable["value"])
        for name, variable in job["variables"].items()
    }
    assert all(variable["expand"] is False for variable in job["variables"].values())
    shell = ("bash", "-eo", "pipefail", "-c", "\n".join(job["script"]))
    process = run(*shell, cwd=workspace, environment=runner | variables)
    assert process.returncode == 1, process.stderr
    for file in job["artifacts"]["reports"].values():
        assert (workspace / file).is_file()
    (entry,) = json.loads((workspace / job["artifacts"]["reports"]["codequality"]).read_text())
    assert entry["location"]["path"] == "build/Reference.fmu"


def test_action_workflow_and_component_have_the_same_inputs() -> None:
    workflow = WORKFLOW[True]["workflow_call"]["inputs"]  # `on` is a boolean in YAML 1.1
    special = {"code-scanning"}, {"artifact"}, {"job", "stage"}
    shared = [
        set(names) - more for names, more in zip((INPUTS, workflow, COMPONENT_INPUTS), special, strict=True)
    ]
    assert shared[0] == shared[1] == shared[2] | {"report"}
    passed_on = WORKFLOW["jobs"]["verify"]["steps"][-1]["with"]
    assert passed_on == {name: f"${{{{ inputs.{name} }}}}" for name in shared[0]}
    for name in shared[0] - {"emla"}:
        assert INPUTS[name].get("default") == workflow[name].get("default")


# ---- what GitHub and GitLab make of it ---------------------------------------------------------


def linted(file: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    options = ("-no-color", f"-shellcheck={PROGRAMS / 'shellcheck'}")
    return run(PROGRAMS / "actionlint", *options, file, cwd=folder)


needs_actionlint = pytest.mark.skipif(
    not (PROGRAMS / "actionlint").is_file(), reason="actionlint has no package for this platform."
)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """With the action where the workflow checks it out, as actionlint looks up the inputs of local ones."""
    (tmp_path / ".github/workflows").mkdir(parents=True)
    (tmp_path / ".git").mkdir()
    (tmp_path / ".emla-verify").mkdir()
    shutil.copy(ROOT / "action.yml", tmp_path / ".emla-verify")
    return tmp_path


@needs_actionlint
@WORKFLOWS
def test_workflows_pass_actionlint(file: Path, repository: Path) -> None:
    for folder in (ROOT, repository):
        if folder != ROOT:
            shutil.copytree(FOLDER, repository / ".github/workflows", dirs_exist_ok=True)
        process = linted(folder / ".github/workflows" / file.name, folder)
        assert (process.returncode, process.stdout) == (0, "")


@needs_actionlint
def test_steps_of_the_action_pass_actionlint(repository: Path) -> None:
    """As those of a workflow, because actionlint does not look at steps of actions."""
    inputs = {name: {"type": "string", "description": about["description"]} for name, about in INPUTS.items()}
    job = {"runs-on": "ubuntu-latest", "steps": STEPS}
    workflow = {"on": {"workflow_call": {"inputs": inputs}}, "jobs": {"verify": job}}
    file = repository / ".github/workflows/steps.yml"
    file.write_text(yaml.safe_dump(workflow), encoding="utf-8")
    process = linted(file, repository)
    assert (process.returncode, process.stdout) == (0, "")


@needs_actionlint
def test_documented_callers_pass_actionlint(repository: Path) -> None:
    """Also the inputs that they give: actionlint looks them up in files of the same repository."""
    assert {remote for remote in LOCAL_PATHS if any(remote in text for text in CALLERS)} == set(LOCAL_PATHS)
    folder = repository / ".github/workflows"
    shutil.copy(FILE, folder)
    for number, text in enumerate(CALLERS):
        local = text
        for remote, path in LOCAL_PATHS.items():
            local = local.replace(remote, path)
        for name, content in (("remote", text), ("local", local)):
            (folder / f"{name}{number}.yml").write_text(content, encoding="utf-8")
            process = linted(folder / f"{name}{number}.yml", repository)
            assert (process.returncode, process.stdout) == (0, "")


def test_documented_includes_give_inputs_of_the_component() -> None:
    text = (ROOT / "docs/verify-in-ci.md").read_text(encoding="utf-8")
    includes = [
        include
        for fence in fences(text)
        if fence.content.startswith("include:")
        for include in yaml.safe_load(fence.content)["include"]
    ]
    assert [sorted({"component", "remote"} & set(include)) for include in includes] == [
        ["component"],
        ["remote"],
    ]
    required = {name for name, about in COMPONENT_INPUTS.items() if "default" not in about}
    for include in includes:
        assert required <= set(include["inputs"]) <= set(COMPONENT_INPUTS)

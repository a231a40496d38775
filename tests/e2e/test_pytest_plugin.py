"""`pytest --fmu`: every check of an FMU is a test."""

import sys
import tomllib
from pathlib import Path

import pytest

import fmu_verify.runner  # noqa: F401 - for pytest runs in this process
from tests.support.broken.editing import with_files
from tests.support.broken.static import LIBRARY
from tests.support.paths import ROOT
from tests.support.pipelines import cut_fmu, good_fmu, strayed_fmu
from tests.support.processes import run as run_program

pytest_plugins = "pytester"

PLUGIN = "fmu_verify.pytest_plugin"
VERIFYING = """
import sys
from dataclasses import replace
import fmu_verify.runner
from fmu_verify.check import warned

module = sys.modules["fmu_verify.runner"]
real = module.verify
"""
"""How a conftest.py begins that puts something between the plugin and `verify`."""


@pytest.fixture
def build(pytester: pytest.Pytester, fmu_folder: Path) -> Path:
    """build/Reference.fmu, which is right, in the current folder."""
    good_fmu(pytester.path / "build", fmu_folder)
    return pytester.path / "build"


def run(pytester: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    """Run pytest in a process of its own."""
    return pytester.runpytest_subprocess("-p", PLUGIN, "-p", "no:cacheprovider", *arguments)


def run_here(pytester: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    """Run pytest in this process, which has loaded what takes time."""
    return pytester.runpytest_inprocess("-p", PLUGIN, "-p", "no:cacheprovider", *arguments)


def passed(result: pytest.RunResult) -> set[str]:
    """What `pytest -rA` says has passed."""
    return {line.split()[1] for line in result.outlines if line.startswith("PASSED ")}


@pytest.mark.slow
def test_every_check_is_a_test(pytester: pytest.Pytester, build: Path) -> None:
    pytester.makepyfile(test_own="def test_own(): pass")
    few = ["--fmu-skip", "[!ar]*"]  # archive, run and reference, which have one check of each kind
    result = run(pytester, "--fmu", "build/*.fmu", "-rA", "--strict-markers", *few)
    assert result.ret == 0
    checks = {f"build/Reference.fmu::{c}" for c in ("archive.safe", "run.completes", "reference.agrees")}
    assert {"test_own.py::test_own", *checks} <= passed(result)


@pytest.mark.slow
def test_selection_by_keyword_mark_name_and_option(pytester: pytest.Pytester, build: Path) -> None:
    pytester.makepyfile(test_own="def test_own(): pass")
    completes, finite = "build/Reference.fmu::run.completes", "build/Reference.fmu::run.finite"
    for arguments, expected in (
        (["--fmu", "build/*.fmu", "-k", "run.finite"], {finite}),
        (["--fmu", "build/*.fmu", "-m", "fmu(check='run.finite')"], {finite}),
        (["--fmu", "build/*.fmu", "-m", "not fmu"], {"test_own.py::test_own"}),
        ([finite], {finite}),
        (["--fmu", "build/*.fmu", completes, finite], {completes, finite}),
        (["--fmu", "build/*.fmu", "--fmu-only", "run.finite", "-m", "fmu"], {finite}),
    ):
        assert passed(run_here(pytester, "-rA", *arguments)) == expected, arguments
    left_out = run_here(
        pytester, "--fmu", "build/*.fmu", "--fmu-skip", "run", "-k", "archive.safe or run.", "-rA"
    )
    assert passed(left_out) == {"build/Reference.fmu::archive.safe"}


@pytest.mark.slow
def test_failure_has_its_message_without_traceback(pytester: pytest.Pytester, fmu_folder: Path) -> None:
    strayed_fmu(pytester.path / "build", fmu_folder)
    agrees = ["--fmu", "build/*.fmu", "-k", "reference.agrees"]
    result = run(pytester, *agrees, "--junitxml=report.xml")
    assert result.ret == 1
    result.stdout.fnmatch_lines(
        [
            "*reference.agrees of Reference.fmu*",
            "* left its tube at t = *",
            "FMI Cross-Check Rules*: \u201c*",
            "Repeat it: emla verify *Reference.fmu --only reference.agrees *",
            "FAILED build/Reference.fmu::reference.agrees - * left its tube *",
            "*1 failed, *",
        ]
    )
    output = result.stdout.str() + (pytester.path / "report.xml").read_text()
    assert "Traceback" not in output and "pytest_plugin" not in result.stdout.str()
    assert run_here(pytester, *agrees, "--fmu-tolerance", "*=1e30").ret == 0


@pytest.mark.slow
def test_fmu_that_cannot_run_fails(pytester: pytest.Pytester) -> None:
    """Once for each cause: what needs a check that has a test is skipped."""
    (pytester.path / "build").mkdir()
    edit = with_files(lambda files: files.update({LIBRARY.replace("64/", "-64/"): files.pop(LIBRARY)}))
    edit(pytester.path / "build")
    for names, failing, skipped in (
        ("archive.safe or run.completes", "run.completes", 0),
        ("binaries.loads or run.completes", "binaries.loads", 1),
    ):
        result = run_here(pytester, "--fmu", "build/*.fmu", "-k", names, "-rA")
        assert result.ret == 1
        result.stdout.fnmatch_lines([f"FAILED build/Toy.fmu::{failing} - It could not run. *"])
        assert result.parseoutcomes().get("skipped", 0) == skipped


@pytest.mark.slow
def test_option_names_the_folder_of_references(pytester: pytest.Pytester, fmu_folder: Path) -> None:
    good_fmu(pytester.path / "kept", fmu_folder)
    (pytester.path / "build").mkdir()
    (pytester.path / "kept" / "Reference.fmu").rename(pytester.path / "build" / "Reference.fmu")
    agrees = ["--fmu", "build/*.fmu", "-k", "reference.agrees", "-rA"]
    run_here(pytester, *agrees).assert_outcomes(passed=1)  # with the reference in the FMU
    run_here(pytester, *agrees, "--fmu-reference", "kept").assert_outcomes(passed=1)
    solution = pytester.path / "kept" / "Reference_ref.csv"
    *rows, last = solution.read_text().splitlines()
    solution.write_text("\n".join([*rows, f"{last.rpartition(',')[0]},9.0", ""]))
    run_here(pytester, *agrees, "--fmu-reference", "kept").assert_outcomes(failed=1)


def test_check_that_needs_a_failed_one_is_skipped_if_that_is_reported(pytester: pytest.Pytester) -> None:
    """Otherwise it fails: pytest would pass although nothing was verified."""
    cut_fmu(pytester.path / "build")
    result = run_here(pytester, "--fmu", "build/*.fmu", "-rs")
    assert result.ret == 1
    result.stdout.fnmatch_lines(["SKIPPED * build/Cut.fmu:*: run.completes: It needs archive.safe*"])
    assert result.parseoutcomes()["failed"] == 1
    result = run_here(pytester, "--fmu", "build/*.fmu", "-k", "run.finite")
    assert result.ret == 1
    result.stdout.fnmatch_lines(["It needs archive.safe, which failed. *"])


@pytest.mark.slow
def test_warning_is_one_of_pytest(pytester: pytest.Pytester, build: Path) -> None:
    pytester.makeconftest(
        VERIFYING + "def verify(*paths, **how):\n"
        "    (one,) = (report := real(*paths, **how)).examined\n"
        "    odd = tuple(replace(f, outcome=warned('It is odd.')) for f in one.findings)\n"
        "    return replace(report, examined=(replace(one, findings=odd),))\n"
        "module.verify = verify\n"
    )
    arguments = ["--fmu", "build/*.fmu", "-k", "run.finite"]
    result = run(pytester, *arguments)
    result.assert_outcomes(passed=1, warnings=1)
    result.stdout.fnmatch_lines(["build/Reference.fmu::run.finite", "*FmuWarning: It is odd.*"])
    strict = run(pytester, *arguments, "-W", "error")
    strict.assert_outcomes(failed=1)
    assert "Traceback" not in strict.stdout.str() and "pytest_plugin" not in strict.stdout.str()


@pytest.mark.slow
def test_workers_share_reports_of_the_selected_checks(pytester: pytest.Pytester, fmu_folder: Path) -> None:
    """No other check runs, so that -k saves time."""
    strayed_fmu(pytester.path / "build" / "a", fmu_folder)
    cut_fmu(pytester.path / "build" / "b")
    pytester.makeini("[pytest]\nfmus = build/*/*.fmu\n")
    pytester.makeconftest(
        VERIFYING + "def verify(path, **how):\n"
        "    with open('verified', 'a') as stream:\n"
        "        print(path.name, *sorted(how['only']), file=stream)\n"
        "    return real(path, **how)\n"
        "module.verify = verify\n"
    )
    few = ("archive.safe", "reference.agrees", "run.finite")
    words = ["-k", " or ".join(few), "-rA", "-v"]
    result = run(pytester, "-n", "2", "--dist", "load", "--maxschedchunk", "1", *words)
    outcomes = result.parseoutcomes()
    assert (outcomes["passed"], outcomes["failed"], outcomes["skipped"]) == (2, 2, 2)
    assert passed(result) == {f"build/a/Reference.fmu::{c}" for c in ("archive.safe", "run.finite")}
    workers = {line.split()[0] for line in result.outlines if line.startswith("[gw")}
    assert workers == {"[gw0]", "[gw1]"}
    verified = (pytester.path / "verified").read_text().splitlines()
    assert sorted(verified) == [" ".join((name, *few)) for name in ("Cut.fmu", "Reference.fmu")]


@pytest.mark.slow
def test_globs_of_the_ini_file(pytester: pytest.Pytester, build: Path) -> None:
    """And only where no paths are given, as with testpaths."""
    pytester.makepyfile(test_own="def test_own(): pass")
    pytester.makeini("[pytest]\nfmus =\n    build/*.fmu\n    build/**/Reference.fmu\n")
    (pytester.path / "below").mkdir()
    everything = run_here(pytester, "-rA", "-k", "test_own or archive.safe")
    assert passed(everything) == {"test_own.py::test_own", "build/Reference.fmu::archive.safe"}
    run_here(pytester, "test_own.py").assert_outcomes(passed=1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fmu", "none/*.fmu"], "*--fmu: there is no file 'none/*.fmu' in *"),
        (["--fmu", "build/*.csv"], "*Reference_in.csv', which matches 'build/[*].csv', is not an FMU."),
        (["--fmu", "build/*.fmu", "--fmu-only", "stat"], "*there is no check 'stat'*"),
        (["--fmu", "build/*.fmu", "--fmu-tolerance", "x"], "*--tolerance x cannot be read*"),
        (["--fmu", "build/*.fmu", "--fmu-reference", "none"], "*there is no folder *none'*"),
    ],
)
def test_invalid_options(pytester: pytest.Pytester, arguments: list[str], words: str) -> None:
    folder = pytester.path / "build"
    cut_fmu(folder)
    (folder / "Reference_in.csv").touch()
    result = run_here(pytester, *arguments)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"ERROR: {words}"])
    assert "Traceback" not in result.stderr.str()


@pytest.mark.slow
def test_glob_without_files_with_workers_and_help(pytester: pytest.Pytester) -> None:
    result = run(pytester, "--fmu", "none/*.fmu", "-n", "1")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert "there is no file" in result.stderr.str() and "Traceback" not in result.stderr.str()
    assert run_here(pytester, "--markers", "--fmu", "none/*.fmu").ret == 0


@pytest.mark.slow
def test_plugin_imports_little() -> None:
    """Nor does it hide the function of the name of the package that it lies in."""
    script = (
        f"import sys, pytest; before = set(sys.modules); import {PLUGIN}\n"
        "new = set(sys.modules) - before\n"
        "print(*sorted(m for m in new if m.startswith(('emla', 'fmu_verify', 'numpy', 'fmpy', 'lxml'))))\n"
        "import emla_cosim\nprint(callable(emla_cosim.verify))\n"
    )
    modules, function = run_program(sys.executable, "-c", script, check=True).stdout.splitlines()
    assert modules.split() == ["fmu_verify", PLUGIN]
    assert function == "True"


@pytest.mark.slow
def test_pytest_without_fmus(pytester: pytest.Pytester) -> None:
    """FMUs in the folder are not tests by themselves."""
    cut_fmu(pytester.path)
    pytester.makepyfile(test_own="import sys\ndef test_own(): assert 'numpy' not in sys.modules")
    result = run(pytester, "-p", "no:hypothesispytest")
    assert result.ret == 0
    result.assert_outcomes(passed=1)


def test_package_names_the_plugin() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {PLUGIN: PLUGIN}

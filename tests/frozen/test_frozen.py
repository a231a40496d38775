"""What users rely on does not change: results, records, help, exit codes, FMUs and packages."""

import math
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from emla_cosim.cli.app import COMMANDS as NAMES
from emla_cosim.cli.app import app
from emla_cosim.fmu.models import MODELS, build, fmu_path
from tests.frozen.commands import COMMANDS, Command
from tests.frozen.record import DIGITS, FOLDER, Frozen, keys_of, last_row, sha256
from tests.support.commands import Emla

TIERS = [pytest.param(name, marks=[pytest.mark.slow] * c.is_slow) for name, c in COMMANDS.items()]


@pytest.fixture
def frozen() -> Frozen:
    return Frozen()


@pytest.mark.parametrize("name", TIERS)
def test_command(name: str, emla: Emla, frozen: Frozen) -> None:
    command = COMMANDS[name]
    output = Path("o")
    rows = "".join(f"{i * 0.001},{1000.0 + 500.0 * math.sin(i / 9)}\n" for i in range(200))
    Path("force.csv").write_text(f"time [s],F_L [N]\n{rows}")
    if command.line.startswith("export"):
        output.mkdir()
    result = emla(*shlex.split(command.line))
    frozen.check("exit codes", name, result.exit_code)
    files = sorted(p.relative_to(output).as_posix() for p in output.rglob("*") if p.is_file())
    frozen.check("files", name, files)
    for record in ("run.json", "metrics.json"):
        if (output / record).exists():
            frozen.check(f"keys of {record}", name, keys_of(output / record))
    _check_tables(name, command, output, frozen)


def _check_tables(name: str, command: Command, output: Path, frozen: Frozen) -> None:
    for file in (*command.bits, *command.values):
        path = output / file
        if path.suffix in (".csv", ".parquet"):
            expected = frozen.content.get("last rows", {}).get(f"{name}: {file}")
            values = last_row(path)
            if not frozen.is_written:
                assert values == pytest.approx(expected, rel=10.0 ** (2 - DIGITS), abs=1e-9, nan_ok=True)
                values = expected
            frozen.check("last rows", f"{name}: {file}", values)
    if frozen.has_bits_of_this_machine(command.iterates):
        for file in command.bits:
            frozen.check("SHA-256", f"{name}: {file}", sha256(output / file))


@pytest.mark.parametrize("command", ["", *NAMES])
def test_help(command: str, frozen: Frozen) -> None:
    text = CliRunner().invoke(app, [*filter(None, [command]), "--help"], terminal_width=80).stdout
    file = FOLDER / "help" / f"{command or 'emla'}.txt"
    if frozen.is_written:
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8"), "run `python -m tests.frozen` if this is wanted"


@pytest.mark.parametrize("model", MODELS)
def test_native_fmu(model: str, fmu_folder: Path, frozen: Frozen) -> None:
    if not frozen.has_bits_of_this_machine():
        pytest.skip("FMUs were frozen with other releases of CasADi and ziglang.")
    frozen.check("SHA-256", f"native {model}", sha256(fmu_path(model, "native", fmu_folder)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["python", "FMI 3.0"])
def test_other_fmus(kind: str, frozen: Frozen, tmp_path: Path) -> None:
    if not frozen.has_bits_of_this_machine():
        pytest.skip("FMUs were frozen with other releases of CasADi, ziglang and PythonFMU.")
    flavour, fmi = ("python", 2) if kind == "python" else ("native", 3)
    for model in ("EmlaPlant", "EmlaObserver", "RsbaController"):
        path = build(model, flavour, [], tmp_path, fmi=fmi)
        frozen.check("SHA-256", f"{kind} {model}", sha256(path))

"""Makes what a release consists of, in build/release; docs/releasing.md says what that is.

    python .ci/release.py

The same commit gives the same bytes, as long as the packages that build it have the same versions.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "orchestration"), str(ROOT / "src")]  # what is released, whatever is installed

from emla_cosim.base.errors import CosimError  # noqa: E402
from emla_cosim.fmu.models import FLAVOURS, MODELS, PLATFORMS, build, fmu_path  # noqa: E402
from fmublock.archive import write_archive  # noqa: E402
from fmublock.files import write_atomically  # noqa: E402

SUMS = "SHA256SUMS"
_README = """\
# FMUs of EMLA-Cosim {version}

FMI 2.0 FMUs for co-simulation and Model Exchange, for {platforms}:

| Folder | What is in it |
|---|---|
| `<Model>/<Model>.fmu` | the FMU as a native library, which needs nothing else |
| `<Model>/python/<Model>.fmu` | the same through PythonFMU, for co-simulation; the host needs Python |
| `<Model>/README.md` | equations, variables, parameters |
| `<Model>/<Model>_*` | inputs, reference results, and how they are to be compared |

`emla verify */*.fmu */python/*.fmu` holds them against their references. LICENSE is their licence.
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make a release, or end with a sentence that says why not, and code 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "build/release", help="folder to write to")
    parser.add_argument("--fmus", type=Path, default=ROOT / "build/fmus", help="folder to build FMUs in")
    parser.add_argument(
        "--platform", action="append", choices=PLATFORMS, help="of native FMUs (repeatable); all without"
    )
    parser.add_argument("--draft", action="store_true", help="also from changed files, and without a date")
    given = parser.parse_args(arguments)
    try:
        release(given.output, given.fmus, given.platform or list(PLATFORMS), given.draft)
    except (CosimError, OSError) as error:
        sys.exit(f"Error: {error}")


def release(output: Path, fmus: Path, platforms: Sequence[str], draft: bool = False) -> None:
    """Write all files of a release to a folder. Raises CosimError and OSError."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    number = project["version"]
    changes = section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), number, draft)
    if not draft and (changed := git("status", "--porcelain")):
        raise CosimError(f"these files are not as they were committed; commit them, or --draft:\n{changed}")
    check_installed(number)
    output.mkdir(parents=True, exist_ok=True)
    forget(output)
    archive = output / f"emla-fmus-{number}.zip"
    write_archive(archive, fmu_files(fmus, platforms, number))
    notes = output / f"CHANGES-{number}.md"
    write(notes, changes.encode())
    materials = bill_of_materials(output / f"emla_cosim-{number}.cdx.json", project["dependencies"])
    files = sorted([archive, notes, materials, *packages(output, platforms)])
    sums = "".join(f"{hashlib.sha256(f.read_bytes()).hexdigest()}  {f.name}\n" for f in files)
    write(output / SUMS, sums.encode())
    for file in (*files, output / SUMS):
        print(file)


def section(changelog: str, number: str, draft: bool = False) -> str:
    """What the changelog says of a version. Raises CosimError where that is nothing, or has no date."""
    found = re.search(rf"^## {re.escape(number)}, (.+)\n((?:(?!## ).*\n?)*)", changelog, re.MULTILINE)
    if found is None or not found[2].strip():
        raise CosimError(f"CHANGELOG.md says nothing of version {number}; give it a section of its own.")
    if not draft and not re.fullmatch(r"\d{4}-\d\d-\d\d", found[1]):
        raise CosimError(
            f"CHANGELOG.md calls version {number} '{found[1]}'; write the day of the release, as in "
            f"`## {number}, 2026-01-31`, or --draft."
        )
    return f"## {number}, {found[1]}\n\n{found[2].strip()}\n"


def check_installed(wanted: str) -> None:
    """Raise CosimError where another version is installed: FMUs say which one made them."""
    try:
        found = version("emla-cosim")
    except PackageNotFoundError:
        found = "nothing"
    if found != wanted:
        raise CosimError(f"{found} is installed, and FMUs would say so; `pip install .` for {wanted}.")


def fmu_files(folder: Path, platforms: Sequence[str], number: str) -> dict[str, bytes]:
    """What the archive of FMUs holds, by names in it; FMUs that are not up to date in `folder` are built."""
    top = f"emla-fmus-{number}"
    about = _README.format(version=number, platforms=", ".join(platforms))
    files = {f"{top}/README.md": about.encode(), f"{top}/LICENSE": (ROOT / "LICENSE").read_bytes()}
    for model in MODELS:
        for flavour in FLAVOURS:
            name = fmu_path(model, flavour, Path(top)).as_posix()
            of_flavour = platforms if flavour == "native" else []
            files[name] = build(model, flavour, of_flavour, folder).read_bytes()
        for file in sorted((ROOT / "fmus" / model).iterdir()):
            if file.suffix != ".fmu" and file.is_file():
                files[f"{top}/{model}/{file.name}"] = file.read_bytes()
    return files


def packages(output: Path, platforms: Sequence[str]) -> list[Path]:
    """The wheel, which carries FMUs for these platforms, and the source distribution, dated by the commit."""
    with TemporaryDirectory(dir=output) as folder:
        command = [sys.executable, "-m", "hatchling", "build", "-d", str(Path(folder).absolute())]
        wanted = "all" if set(platforms) == set(PLATFORMS) else ",".join(platforms)
        run(command, dated() | {"EMLA_COSIM_PLATFORMS": wanted})
        return [file.replace(output / file.name) for file in Path(folder).iterdir()]


def bill_of_materials(path: Path, requirements: Sequence[str]) -> Path:
    """Write the packages that an installation without extras has, as CycloneDX. Raises CosimError.

    Args:
        path: The JSON file to write.
        requirements: Requirements of the project, which pip resolves in an empty environment.
    """
    with TemporaryDirectory() as folder:
        run([sys.executable, "-m", "venv", "--without-pip", folder])
        python = str(Path(folder, "Scripts/python.exe" if os.name == "nt" else "bin/python"))
        pip = [sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check"]
        run([*pip, "install", "--quiet", "--no-compile", *requirements])
        command = [sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible"]
        run([*command, "--pyproject", "pyproject.toml", "-o", str(path.absolute()), python], dated())
    return path


def dated() -> dict[str, str]:
    """The environment of commands whose outputs are dated by the commit. Raises CosimError."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH") or git("log", "-1", "--format=%ct")
    return {**os.environ, "SOURCE_DATE_EPOCH": epoch}


def forget(output: Path) -> None:
    """Remove the files of an earlier release from its folder, and nothing else."""
    sums = output / SUMS
    if sums.is_file():
        for line in sums.read_text(encoding="utf-8").splitlines():
            (output / Path(line.partition("  ")[2]).name).unlink(missing_ok=True)
        sums.unlink()


def write(path: Path, content: bytes) -> None:
    """Write a file whole. Raises OSError."""
    with write_atomically(path) as stream:
        stream.write(content)


def git(*arguments: str) -> str:
    """What git says of the tree. Raises CosimError."""
    return run(["git", *arguments]).strip()


def run(command: Sequence[str], env: Mapping[str, str] | None = None) -> str:
    """What a command shows that ends well. Raises CosimError for others."""
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CosimError(f"`{' '.join(command)}` ended with {done.returncode}: {done.stderr.strip()}")
    return done.stdout


if __name__ == "__main__":
    main()

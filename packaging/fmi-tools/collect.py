"""Make the example files that the FMI site's list of tools asks for, from the FMUs of a release.

python packaging/fmi-tools/collect.py build/release/emla-fmus-VERSION.zip FOLDER
"""

import csv
import io
import sys
import zipfile
from pathlib import Path, PurePosixPath

MOST_SIGNALS = 10
"""The list recommends at most as many signals in a solution."""

START_VALUES = """\
The reference solution in {model}_ref.csv needs the start values in {model}_ref.toml, section [set]:
set them before initialization. The section [tolerance] says how far a result may differ.

"""


def main(archive: Path, folder: Path) -> None:
    """Write a folder for each FMU of the archive. Raises OSError and zipfile.BadZipFile."""
    with zipfile.ZipFile(archive) as release:
        for name in release.namelist():
            path = PurePosixPath(name)
            if path.parent.parent.name != archive.stem:
                continue  # not of a native FMU
            model, content = path.parent.name, release.read(name)
            match path.name.removeprefix(model):
                case ".fmu" | "_ref.opt" | "_ref.toml" as suffix:
                    target = f"{model}{suffix}"
                case "_in.csv" as suffix:
                    target, content = f"{model}{suffix}", quote_names(content)
                case "_ref.csv" as suffix:
                    target, content = f"{model}{suffix}", quote_names(content, MOST_SIGNALS)
                case "README.md":
                    target, content = "Readme.txt", START_VALUES.format(model=model).encode() + content
                case _:
                    continue
            (folder / model).mkdir(parents=True, exist_ok=True)
            (folder / model / target).write_bytes(content)


def quote_names(table: bytes, signals: int | None = None) -> bytes:
    """Return a CSV with its time, its first `signals` columns (all without), and names in quotes."""
    names, *rows = csv.reader(io.StringIO(table.decode()))
    width = len(names) if signals is None else signals + 1
    lines = [",".join(f'"{name}"' for name in names[:width]), *(",".join(row[:width]) for row in rows)]
    return "\n".join([*lines, ""]).encode()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))

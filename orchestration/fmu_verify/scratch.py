"""The folder in which the process of a check works, so that an FMU changes none of the user's files."""

import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from emla_cosim.base.errors import CosimError
from emla_cosim.base.files import CacheError, cache_folder
from emla_cosim.stepper.library import require_stepper

from .confinement import can_confine
from .subject import Subject, WholeSystem

_CACHE, _CODE = "cache", "code"
"""The folder of the cache in the scratch folder, and of the compiled stepper in the cache."""


def list_writable(subject: Subject | WholeSystem, records: bool = False) -> list[Path]:
    """Return the folders that a check of an FMU or of a system may change, and make its scratch folder.

    `records` says whether the check writes reference files. Call it before the check is confined: then no
    folder of the user is writable, and the user's cache is not found.
    """
    subject.scratch.mkdir(parents=True, exist_ok=True)
    # a system runs, or the events of an FMU are handled
    is_system = isinstance(subject, WholeSystem)
    needs_stepper = is_system or (subject.known_version == 3 and "CoSimulation" in subject.kinds)
    if needs_stepper and not (cache := subject.scratch / _CACHE).exists():
        _copy_stepper(cache)
    recording = subject.settings.recording
    return [subject.scratch, *([recording.folder.absolute()] if recording is not None and records else [])]


def use_scratch(subject: Subject | WholeSystem) -> None:
    """Let this process have its working, home and temporary folders in the scratch folder of its subject.

    The home folder has links to what is in the user's, such as licenses, if the process is confined so that
    it cannot change them. References are recorded from the working folder of the user.
    """
    home, temporary, working = (subject.scratch / name for name in ("home", "temporary", "working"))
    if os.environ.get("HOME") != str(home):
        os.environ["EMLA_COSIM_CACHE"] = str(subject.scratch / _CACHE)
        for folder in (home, temporary, working):
            folder.mkdir(exist_ok=True)
        with suppress(OSError, RuntimeError):  # there is no home folder, or it cannot be read
            for path in Path.home().iterdir() if can_confine() else ():
                with suppress(FileExistsError):
                    (home / path.name).symlink_to(path)
        os.environ.update({name: str(home) for name in ("HOME", "USERPROFILE")})
        os.environ.update({name: str(temporary) for name in ("TMPDIR", "TEMP", "TMP")})
        tempfile.tempdir = str(temporary)
    if subject.settings.recording is None:
        os.chdir(working)


def _copy_stepper(folder: Path) -> None:
    """Copy the compiled stepper to another cache folder.

    It is built now if necessary: the compiler cannot rename files in a confined process.
    """
    folder.mkdir(exist_ok=True)
    with suppress(OSError, CacheError, CosimError):
        require_stepper()
        source = cache_folder() / _CODE
        if source.is_dir():
            shutil.copytree(source, folder / _CODE, dirs_exist_ok=True)

"""Confine a process: it writes files only in some folders, such as that of its check.

This uses Landlock of the Linux kernel, which needs no rights and no package.
"""

import ctypes
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from emla_cosim.base.errors import CosimError
from emla_cosim.base.files import CacheError, cache_folder
from emla_cosim.stepper.library import require_stepper

from .subject import Subject, WholeSystem

# numbers of the system calls; the same on all processors but Alpha
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446

_ASK_VERSION, _PATH_BENEATH, _NO_NEW_PRIVILEGES = 1, 1, 38

_WRITE_FILE, _REFER, _TRUNCATE = 1 << 1, 1 << 13, 1 << 14
# remove folders and files; make files, folders, links, pipes, sockets and devices
_CHANGE_FOLDER = sum(1 << k for k in range(4, 13))

_SCOPE_SIGNALS = 1 << 1

_REFER_SINCE, _TRUNCATE_SINCE, _SIGNALS_SINCE = 2, 3, 6
"""Versions of Landlock, of Linux 5.19, 6.2 and 6.12."""

DEVICES = tuple(Path("/dev", name) for name in ("null", "zero", "full", "tty"))
"""Devices that a confined process may write to."""


class _Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


@cache
def _read_version() -> int:
    """Return the version of Landlock; 0 if the system does not have it or does not use it."""
    if sys.platform != "linux" or platform.machine() == "alpha":
        return 0
    with suppress(AttributeError, OSError):
        return max(0, _call_system(_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(_ASK_VERSION)))
    return 0


def list_confinement_gaps() -> Iterator[str]:
    """Yield what `confine` cannot prevent on this system, as sentences."""
    version = _read_version()
    if version == 0:
        yield (
            "Files outside: this system cannot confine an FMU (Linux 5.13 with Landlock can). It can "
            "change files outside of its temporary folder."
        )
    elif version < _TRUNCATE_SINCE:
        yield "Files outside: this system cannot keep an FMU from emptying them (Linux 6.2 can)."
    if 0 < version < _SIGNALS_SINCE:
        yield "Other processes: this system cannot keep an FMU from sending them signals (Linux 6.12 can)."


def can_confine() -> bool:
    """Return whether `confine` keeps a process from writing outside of its folders."""
    return _read_version() >= _TRUNCATE_SINCE


@cache
def confine_signals() -> None:
    """Keep this process from sending signals to others but those that it starts, if the system can.

    An FMU in a copy of this process can still send some to this process: that is noticed.
    """
    if _read_version() >= _SIGNALS_SINCE:
        _restrict(_Ruleset(0, 0, _SCOPE_SIGNALS), {})


def confine(writable: Iterable[Path]) -> bool:
    """Confine this thread, and the threads and processes that it starts from now on, permanently.

    Reading is not restricted. A second call restricts further. Signals reach only this process and those
    that it starts, or what `confine_signals` allows.

    Args:
        writable: Folders and files that may be changed. Those that do not exist are left out.

    Returns:
        Whether the system confines the process.
    """
    version = _read_version()
    if version == 0:
        return False
    file_rights = _WRITE_FILE | (_TRUNCATE if version >= _TRUNCATE_SINCE else 0)
    all_rights = file_rights | _CHANGE_FOLDER | (_REFER if version >= _REFER_SINCE else 0)
    rules = _Ruleset(all_rights, 0, 0 if confine_signals.cache_info().currsize else _SCOPE_SIGNALS)
    allowed = {path: all_rights if path.is_dir() else file_rights for path in (*writable, *DEVICES)}
    _restrict(rules, allowed)
    return True


def _restrict(rules: _Ruleset, allowed: Mapping[Path, int]) -> None:
    """Restrict this thread to what rules leave, and what is allowed on and beneath paths that exist."""
    # older versions of Landlock know the first field only
    size = ctypes.sizeof(rules) if _read_version() >= _SIGNALS_SINCE else ctypes.sizeof(ctypes.c_uint64)
    ruleset = _call_system(_CREATE_RULESET, ctypes.byref(rules), ctypes.c_size_t(size), ctypes.c_uint32(0))
    try:
        for path, access in allowed.items():
            with suppress(FileNotFoundError):
                descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
                try:
                    rule = ctypes.byref(_Beneath(access, descriptor))
                    _call_system(
                        _ADD_RULE,
                        ctypes.c_int(ruleset),
                        ctypes.c_int(_PATH_BENEATH),
                        rule,
                        ctypes.c_uint32(0),
                    )
                finally:
                    os.close(descriptor)
        # without it, only a privileged process may restrict itself
        ctypes.CDLL(None).prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
        _call_system(_RESTRICT_SELF, ctypes.c_int(ruleset), ctypes.c_uint32(0))
    finally:
        os.close(ruleset)


def _call_system(number: int, *arguments: Any) -> int:
    """Return the result of a system call. Raise OSError if it fails."""
    library: Any = ctypes.CDLL(None, use_errno=True)
    library.syscall.restype = ctypes.c_long
    result = library.syscall(ctypes.c_long(number), *arguments)
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return int(result)


_CACHE, _CODE = "cache", "code"
"""The folder of the cache in the scratch folder, and of the compiled stepper in the cache."""


def prepare_writable_folders(subject: Subject | WholeSystem, records: bool = False) -> list[Path]:
    """Make the scratch folder of a check, with the stepper if it needs it; return folders that it may change.

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

    It is built now if necessary: the compiler cannot rename files in a confined process. Nothing is copied
    if that fails.
    """
    folder.mkdir(exist_ok=True)
    with suppress(OSError, CacheError, CosimError):
        require_stepper()
        source = cache_folder() / _CODE
        if source.is_dir():
            shutil.copytree(source, folder / _CODE, dirs_exist_ok=True)

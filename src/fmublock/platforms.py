"""Platforms for which native FMUs can be built, on any machine."""

import os
import platform
import sys
from functools import cache

# FMI platform -> zig target and file suffix. Every Linux of the last decade has glibc 2.17.
# macOS 11 is the first on both processors; without a version, zig demands one of the newest.
TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so"),
    "win64": ("x86_64-windows-gnu", ".dll"),
    "darwin64": ("x86_64-macos.11.0", ".dylib"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", ".so"),
    "aarch64-darwin": ("aarch64-macos.11.0", ".dylib"),
}

FMI_VERSIONS = (2, 3)
"""Versions of FMI for which native FMUs can be built."""

_FMI3_FOLDERS = {"linux64": "x86_64-linux", "win64": "x86_64-windows", "darwin64": "x86_64-darwin"}


def binaries_folder(platform: str, fmi: int) -> str:
    """Return the name of a platform's folder in `binaries/`: FMI 3.0 has other names than FMI 2.0."""
    return _FMI3_FOLDERS.get(platform, platform) if fmi == 3 else platform


def platform_of(folder: str) -> str:
    """Return the platform of a folder in `binaries/`, for any version of FMI."""
    return next((p for p, name in _FMI3_FOLDERS.items() if name == folder), folder)


def zig_target(platform: str) -> str:
    """Return the name by which zig knows a platform; on this machine that of its C library."""
    target = TARGETS[platform][0]
    return target.replace("gnu.2.17", "musl") if platform == host_platform() and has_musl() else target


@cache
def has_musl() -> bool:
    """Return whether this is a Linux without glibc, such as Alpine, whose libraries differ."""
    if sys.platform != "linux":
        return False
    try:
        return not os.confstr("CS_GNU_LIBC_VERSION")
    except (OSError, ValueError):
        return True


def host_platform() -> str:
    """Return the FMI platform of this machine."""
    system = {"Windows": "win"}.get(platform.system(), platform.system().lower())
    arm = platform.machine().lower() in ("arm64", "aarch64")
    return f"aarch64-{system}" if arm else f"{system}64"

"""Platforms for which native FMUs can be built, on any machine."""

import platform

# FMI platform -> zig target and file suffix; every Linux of the last decade has glibc 2.17
TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so"),
    "win64": ("x86_64-windows-gnu", ".dll"),
    "darwin64": ("x86_64-macos", ".dylib"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", ".so"),
    "aarch64-darwin": ("aarch64-macos", ".dylib"),
}


def host_platform() -> str:
    """Return the FMI platform of this machine."""
    system = {"Windows": "win"}.get(platform.system(), platform.system().lower())
    arm = platform.machine().lower() in ("arm64", "aarch64")
    return f"aarch64-{system}" if arm else f"{system}64"

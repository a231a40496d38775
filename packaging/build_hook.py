"""Wheels carry what would else be built on first use: the stepper and the FMUs of our models.

The wheel of `pip install .` is for this machine. With EMLA_COSIM_PLATFORMS=all it is for every machine.
Editable installations, and HATCH_BUILD_NO_HOOKS=true, bring nothing; FMUs are then built on first use.
"""

import atexit
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_VARIABLE = "EMLA_COSIM_PLATFORMS"
_NEEDED = ("attrs", "filelock", "fmpy", "latex2mathml", "lazy-loader", "markdown-it-py", "mdit-py-plugins")
_NEEDED += ("msgspec", "numpy", "platformdirs", "casadi", "matplotlib", "ziglang")
"""Those of our requirements, and of the extra 'build', that building native FMUs needs."""


class PrebuildHook(BuildHookInterface):
    """Builds the FMUs and the stepper, and adds them to the wheel."""

    def dependencies(self) -> list[str]:
        """Return the requirements of building; none for editable installations (by the call of pip)."""
        if "get_requires_for_build_editable" in sys.argv:
            return []
        core = self.metadata.core
        declared = [*core.dependencies, *core.optional_dependencies["build"]]
        return [requirement for requirement in declared if _normalize(requirement) in _NEEDED]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build what the wheel carries; `version` is 'editable' for an editable installation."""
        if version == "editable":
            return
        self._folder = Path(tempfile.mkdtemp(prefix="emla-prebuilt-"))
        atexit.register(shutil.rmtree, self._folder, ignore_errors=True)
        wanted = os.environ.get(_VARIABLE, "")
        root, metadata, built = Path(self.root), self._folder / "metadata", self._folder / "cache"
        self._write_metadata(metadata)
        path = [str(root / "src"), str(root / "orchestration"), str(metadata)]
        path += filter(None, [os.environ.get("PYTHONPATH")])  # where pip has the requirements of building
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path)}
        command = [sys.executable, str(root / "packaging" / "prebuild.py"), str(built), wanted]
        # in an empty folder, as FMUs of a folder fmus/ precede those of the cache
        done = subprocess.run(command, env=environment, check=False, cwd=self._folder)
        if done.returncode != 0:
            self.app.abort("The FMUs of the wheel were not built; the error is above.")
        build_data["force_include"][str(built)] = "fmublock/prebuilt"
        if not wanted:  # otherwise it is for several machines
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{re.sub(r'[-.]', '_', sysconfig.get_platform())}"

    def _write_metadata(self, folder: Path) -> None:
        """Let the sources find their version, which FMUs contain, before they are installed."""
        name, version = "emla_cosim", self.metadata.version
        info = folder / f"{name}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: emla-cosim\nVersion: {version}\n")


def _normalize(requirement: str) -> str:
    """Return the name of a distribution, as PyPI compares it."""
    match = re.match(r"[\w.-]+", requirement)
    return re.sub(r"[-_.]+", "-", match[0]).lower() if match else ""

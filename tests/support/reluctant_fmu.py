"""Builds the FMU that is careless with its start values, or slow; see reluctant/reluctant.c."""

from pathlib import Path

from tests.support.handwritten_fmu import build_handwritten_fmu


def build_reluctant_fmu(path: Path, tolerance: str = "1e-5") -> Path:
    """Build the FMU for this machine, with the tolerance of its default experiment."""
    source = Path(__file__).parent / "reluctant" / "reluctant.c"
    return build_handwritten_fmu(path, source, {"tolerance": tolerance})

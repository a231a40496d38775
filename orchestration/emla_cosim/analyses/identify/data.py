"""The result of an identification, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars
from numpy.typing import NDArray

from .certainty import Estimate
from .design import Candidate
from .fit import Fit


@dataclass(frozen=True)
class IdentificationData:
    """Estimates with their certainty, and the fit; `IdentificationResult` explains the fields."""

    name: str
    estimates: Sequence[Estimate]
    set: Mapping[str, Any]
    correlations: NDArray[np.float64]
    condition: float
    fits: Sequence[Fit]
    sigma: Mapping[str, float]
    samples: polars.DataFrame
    history: polars.DataFrame
    candidates: Sequence[Candidate] = ()
    complete: bool = True
    converged: bool = True
    runs: int = 0
    wall_s: float = 0.0
    notes: Sequence[str] = field(default_factory=list)
    folder: Path | None = None

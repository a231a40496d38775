"""How an FMU that runs as Model Exchange is integrated."""

from typing import NamedTuple


class IntegratorSettings(NamedTuple):
    """Settings of the integrator.

    Attributes:
        tolerance: relative tolerance. The absolute ones are its products with the states' nominal values.
        method: one of `METHODS` of `fmu.cvode`.
        largest: largest step in s; None for no limit but the communication step.
    """

    tolerance: float = 1e-5
    method: str = "bdf"
    largest: float | None = None

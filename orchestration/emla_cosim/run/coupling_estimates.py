"""Estimate the coupling errors of the runs of a simulation, within a share of their time."""

from ..master.coupling.estimate import ALLOWANCE, SHARE, CouplingError
from ..master.stepping.fixed_steps import FixedSteps
from .coupling_summary import EARLIER_RUN
from .execution import ActiveRun


class CouplingEstimates:
    """Estimates the errors of runs one after another.

    A run that repeats the last one has its estimate. Many short runs save up their shares of time for one.

    Attributes:
        has_failed: Whether an FMU failed in the last call of `estimate`.
    """

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._last, self._saved_s = CouplingError(), 0.0
        self.has_failed = False

    def estimate(self, run: ActiveRun) -> CouplingError:
        """Return the coupling error of a run that has ended. Its FMUs cannot be used afterwards."""
        self.has_failed, stepping = False, run.stepping
        estimate = stepping.estimate if isinstance(stepping, FixedSteps) else None
        if estimate is None or run.problem is not None or run.requested_end is not None:
            return run.coupling.without_estimate()
        key = str(stepping.algorithm), stepping.times, run.definition.system, run.steps
        if key == self._key:
            return self._last
        share = SHARE * run.wall_s
        # preparing a first run with such steps takes far longer; the runs that follow save up their shares
        allowed = share + (ALLOWANCE if key[:2] != self._key[:2] else self._saved_s)
        self._saved_s = 0.0 if allowed >= ALLOWANCE else allowed
        if allowed < ALLOWANCE:
            return CouplingError(not_estimated=EARLIER_RUN)
        self._last = estimate.estimate(allowed, run.wall_s / max(run.steps, 1))
        self._key, self.has_failed = key, self._last.is_fault
        return self._last

"""Step an FMI 3.0 FMU with event mode and early return."""

from dataclasses import dataclass

from .hosted_instance import HostedInstance

_MOST = 1000
"""Most iterations of one event, and most returns within one step."""


@dataclass
class EventRun:
    """What happened in a run so far.

    Attributes:
        steps: Number of steps.
        events: How often a step asked for event mode.
        returns: Number of early returns.
        early: Time in s of the first early return for no end of the run.
        astray: Begin and end of a step, and the time outside of it at which it returned early.
        reached: Time reached, in s.
        terminated: Whether the FMU asked to end the run.
    """

    steps: int = 0
    events: int = 0
    returns: int = 0
    early: float | None = None
    astray: tuple[float, float, float] | None = None
    reached: float = 0.0
    terminated: bool = False

    def enter_event_mode(self, instance: HostedInstance) -> None:
        """Enter event mode."""
        with instance.calling():
            instance.fmu.enterEventMode()

    def handle_events(self, instance: HostedInstance) -> None:
        """Update the discrete states until they need no update."""
        for _ in range(_MOST):
            with instance.calling():
                needed, terminate, *_ = instance.fmu.updateDiscreteStates()
            self.terminated = self.terminated or bool(terminate)
            if not needed or terminate:
                return
        raise instance.error("fmi3UpdateDiscreteStates, called repeatedly,", 3)

    def leave_event_mode(self, instance: HostedInstance) -> None:
        """Enter step mode."""
        with instance.calling():
            instance.fmu.enterStepMode()

    def step(self, instance: HostedInstance, begin: float, end: float, has_mode: bool) -> None:
        """Step to the end, with as many calls as the FMU needs."""
        self.steps += 1
        close = 1e-9 * (end - begin)
        for _ in range(_MOST):
            with instance.calling():
                event, terminate, early, self.reached = instance.fmu.doStep(
                    begin, end - begin, noSetFMUStatePriorToCurrentPoint=True
                )
            self.terminated = self.terminated or bool(terminate)
            if self.terminated:
                return
            if early:
                self.returns += 1
                self.early = self.reached if self.early is None else self.early
                if not begin - close <= self.reached <= end + close:
                    self.astray = begin, end, self.reached
                    return
            if event:
                self.events += 1
                if has_mode:
                    self.enter_event_mode(instance)
                    self.handle_events(instance)
                    self.leave_event_mode(instance)
            if not early or self.reached >= end - close:
                return
            begin = self.reached
        raise instance.error(f"fmi3DoStep at t = {begin:.9g} s, called repeatedly,", 3)

"""Do fixed steps in C, or in several threads of the loop that numba compiles."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ...base.arrays import Vector
from ...base.errors import RunError
from ..algorithms.tasks import StepTask
from .native_loop import NativeLoop
from .timing import Clock

if TYPE_CHECKING:
    from .kernel import Kernel


class SwitchingLoop:
    """The stepper in C in one thread, and numba's loop in several. A run can switch between its calls.

    Args:
        native: The stepper in C.
        compile_kernel: Returns numba's loop; None if there is none. Called when several threads are to share
            the steps for the first time.
        can_share: Whether several threads can share the steps.
    """

    def __init__(
        self, native: NativeLoop, compile_kernel: "Callable[[], Kernel | None]", can_share: bool
    ) -> None:
        self.native, self._compile_kernel, self.can_share = native, compile_kernel, can_share
        self._kernel: Kernel | None = None
        self.together = False
        """Whether `run` uses all lanes, after `share_out` among several."""

    @property
    def needs_python(self) -> bool:
        """Whether Python must do the step after `run`."""
        return self.together and self._threaded.needs_python

    @property
    def seconds_beside(self) -> float:
        """Wall time in s that further threads took for steps."""
        return 0.0 if self._kernel is None else self._kernel.seconds_beside

    @property
    def threads(self) -> int:
        """Number of threads in `run`."""
        return self._threaded.threads if self.together else 1

    @property
    def _threaded(self) -> "Kernel":
        if self._kernel is None and (made := self._compile_kernel()) is not None:
            self._kernel = made
        if self._kernel is None:
            raise RunError("the loop for several threads cannot be compiled. Set one thread.")
        return self._kernel

    def share_out(self, work: Sequence[StepTask], lanes: Sequence[Sequence[int]]) -> None:
        """Share the steps among threads; see `Kernel.share_out`."""
        self._threaded.share_out(work, lanes)
        self.together = len(lanes) > 1

    def handover(self) -> float:
        """Return the seconds that the lanes need to synchronize in an empty step."""
        return self._threaded.handover()

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do steps, and record rows; see `NativeLoop.run`."""
        if not self.together:
            return self.native.run(first, count, clock, every, rows)
        self._threaded.together = True
        return self._threaded.run(first, count, clock, every, rows)

    def why_not_kept(self) -> str:
        """Return why compiled code could not be cached; empty if it was."""
        return self.native.why_not_kept()

    def close(self) -> None:
        """Free saved states and end threads; never raises."""
        self.native.close()
        if self._kernel is not None:
            self._kernel.close()

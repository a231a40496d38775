"""Which step-size controls there are."""

from .step_size_control import ErrorControlledStepSize, FixedStepSize, StepSizeControl

STEP_SIZE_CONTROLS: dict[str, type[StepSizeControl]] = {
    "fixed": FixedStepSize,
    "error": ErrorControlledStepSize,
}
"""Step-size controls by name. A class that is added here can be chosen wherever a name is given.

Without a name, the one that has the options that are given is chosen, or else the first.
"""

"""The registry of step-size controls."""

from .step_size_control import ErrorControlledStepSize, FixedStepSize, StepSizeControl

STEP_SIZE_CONTROLS: dict[str, type[StepSizeControl]] = {
    "fixed": FixedStepSize,
    "error": ErrorControlledStepSize,
}
"""Step-size controls by name. Add a class to select it by its name.

Without a name, the control that has the user's options is selected; the default is the first.
"""

"""All checks, in the order in which they are done and shown: what a check needs stands before it."""

from .check import Check
from .checks import archive, description, instances, references, runs

CHECKS: tuple[Check, ...] = (
    archive.safe,
    description.readable,
    instances.created,
    runs.completes,
    runs.finite,
    references.agrees,
)

RECORDED = references.recorded
"""What is done instead where references are to be made."""

"""The optimised motion of the manipulator: solve, write and read its file, and draw it."""

from ...base.extras import require_extras

require_extras(("analyses", "build"), "optimising a motion")

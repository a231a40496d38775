"""Other names of `hand_written_fmus`, for a while."""

from tests.support.hand_written_fmus import *  # noqa: F403

"""What makes a test run the same on every machine: examples of properties, and Ctrl-C."""

import signal

from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

SAME, EXPLORE = "same", "explore"
"""Profiles: the same examples every time, and new ones every time."""


def register_profiles() -> None:
    """Register the profiles of hypothesis and load `same`; `--hypothesis-profile explore` loads the other.

    No profile fails because a machine is slow. The same examples are few: each costs time in every run.
    """
    slow = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow], "print_blob": True}
    settings.register_profile(EXPLORE, settings(**slow, derandomize=False, max_examples=100))
    settings.register_profile(SAME, settings(**slow, derandomize=True, database=None, max_examples=30))
    settings.load_profile(SAME)


def draw_no_constants_of_modules() -> None:
    """Keep hypothesis from drawing the constants of whatever project modules are loaded.

    Which these are depends on how the project is installed, on the tests that ran before, and on the
    process of pytest-xdist.
    """
    if hasattr(providers, "_get_local_constants"):
        providers._get_local_constants = lambda: providers._local_constants


def heed_ctrl_c() -> None:
    """Let this process and those that it starts end by SIGINT, which a shell's background job ignores."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)

"""Python imports this at its start where this folder is on its path: see `injected_failures`."""

from tests.support.injected_failures import watch_this_process

watch_this_process()

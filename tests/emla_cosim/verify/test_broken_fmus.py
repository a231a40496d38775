"""FMUs with one thing wrong: the check for it says so, what needs that is skipped, and all others pass.

The documentation's table of them is made here: `python -m tests.emla_cosim.verify.broken_table` writes it.
"""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.verify.catalogue import CHECKS
from emla_cosim.verify.report import Examined
from emla_cosim.verify.verdict import Verdict
from tests.support.broken.broken import BROKEN_TABLE, Broken
from tests.support.broken.dynamic import DYNAMIC, build_good_fmu
from tests.support.broken.editing import good_bytes
from tests.support.broken.numeric import NUMERIC
from tests.support.broken.static import STATIC
from tests.support.paths import ROOT

BROKEN = [*STATIC, *DYNAMIC, *NUMERIC]

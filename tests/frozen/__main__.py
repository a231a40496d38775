"""Write frozen.json and help/ anew: `python -m tests.frozen [-k EXPRESSION]`."""

import os
import sys
from pathlib import Path

import pytest

from tests.frozen.record import WRITE

os.environ[WRITE] = "1"
folder = str(Path(__file__).parent)
sys.exit(pytest.main(["-n0", "-m", "", folder, *sys.argv[1:]]))

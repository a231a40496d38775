"""FMUs with one thing wrong: the check for it says so, what needs that is skipped, and all others pass.

The documentation's table of them is made here: `python -m tests.emla_cosim.verify.broken_table` writes it.
"""

from tests.support.broken.dynamic import DYNAMIC
from tests.support.broken.numeric import NUMERIC
from tests.support.broken.static import STATIC

BROKEN = [*STATIC, *DYNAMIC, *NUMERIC]

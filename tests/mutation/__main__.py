"""Puts faults into a copy of the project, one at a time, and counts those that the tests notice.

python -m tests.mutation cover          runs both tiers with coverage, once
python -m tests.mutation try --seed 1   tries what is left of a drawing
python -m tests.mutation report         lists what was noticed, and what was not
"""

import argparse
import os
import sys

from tests.support.paths import ROOT

from .covering import FOLDER, measure
from .mutants import draw
from .report import report
from .trials import Trials


def main() -> None:
    """Cover, try or report."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutation", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("action", choices=["cover", "try", "report"])
    parser.add_argument("--tier", choices=["default", "slow"], help="of `cover`; default: both")
    parser.add_argument("--seed", type=int, default=1, help="of the drawing")
    parser.add_argument("--again", action="store_true", help="try survivors again, with tests added since")
    parser.add_argument("tests", nargs="*", help="of `cover`: files or folders; default: all")
    arguments = parser.parse_args()
    if arguments.action == "cover":
        tiers = [arguments.tier] if arguments.tier else ["default", "slow"]
        sys.exit(max(measure(tier, arguments.tests) for tier in tiers))
    trials = Trials(arguments.seed)
    if arguments.action == "try":
        trials.run(draw(arguments.seed, FOLDER / f"seed-{arguments.seed}.json"), arguments.again)
    print(report(trials.results()))


if __name__ == "__main__":
    os.chdir(ROOT)
    main()

"""Paths that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SUPPORT = Path(__file__).parent
FOREIGN_PLANT = SUPPORT / "foreign_plant"
FOREIGN_MAPPING = FOREIGN_PLANT / "ForeignPlant.ssm"
"""Maps the names of our plant to those of the foreign one."""

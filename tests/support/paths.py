"""Where things are that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
FOREIGN_PLANT = Path(__file__).parent / "foreign_plant"
ALL_TYPES = Path(__file__).parent / "all_types" / "all_types.c"
"""An FMU with variables of all types."""
FOREIGN_MAPPING = FOREIGN_PLANT / "ForeignPlant.ssm"
"""Maps the names of our plant to those of the foreign one."""

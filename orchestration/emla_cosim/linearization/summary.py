"""Terminal output of a linearization."""

import math

from rich.markup import escape
from rich.table import Table

from .result import LinearizeResult

_ROWS = (
    ("phase margin", "phase_deg", "phase_at", "°", 1.0),
    ("gain margin, up", "gain_up_dB", "gain_up_at", "dB", 1.0),
    ("gain margin, down", "gain_down_dB", "gain_down_at", "dB", 1.0),
    ("delay margin", "delay_s", None, "ms", 1e3),
    ("sensitivity Ms", "Ms", "Ms_at", "", 1.0),
)


def format_margins(result: LinearizeResult) -> list[Table]:
    """Return a table of margins for each loop."""
    tables = []
    for name, margins in result.margins.items():
        table = Table(title=escape(f"{name}, t = {result.at:g} s"), title_justify="left")
        for heading in ("", "margin", "", "at / Hz"):
            table.add_column(heading, justify="right" if heading in ("margin", "at / Hz") else "left")
        for label, value, at, unit, factor in _ROWS:
            found, where = getattr(margins, value), None if at is None else getattr(margins, at)
            is_known = math.isfinite(found)
            table.add_row(
                label,
                f"{factor * found:.4g}" if is_known else "none",
                unit if is_known else "",
                f"{where:.4g}" if is_known and where is not None else "",
            )
        tables.append(table)
    return tables


def format_lines(result: LinearizeResult) -> list[str]:
    """Return lines on how the responses were measured."""
    how = "restored states" if result.rolled_back else "repeated runs, as not every FMU can restore its state"
    lines = [
        f"{name}: pulses of {m.amplitude:.3g}, nonlinearity {100.0 * m.nonlinearity:.2g} %"
        for name, m in result.responses.items()
    ]
    return [*(f"Note: {text}" for text in result.remarks), *lines, f"Measured with {how}"]

"""Terminal output of a linearization."""

import math

from rich.markup import escape
from rich.table import Table

from .result import LinearizeResult
from .state_space import StateSpace

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
        halved = result.responses[name].margins_at_half_step
        table = Table(title=escape(f"{name}, t = {result.at:g} s"), title_justify="left")
        for heading in ("", "margin", "", "at / Hz", "half step"):
            table.add_column(heading, justify="right" if heading else "left")
        for label, value, at, unit, factor in _ROWS:
            found, where = getattr(margins, value), None if at is None else getattr(margins, at)
            is_known = math.isfinite(found)
            table.add_row(
                label,
                f"{factor * found:.4g}" if is_known else "none",
                unit if is_known else "",
                f"{where:.4g}" if is_known and where is not None else "",
                "not judged" if halved is None else _change(factor * (getattr(halved, value) - found)),
            )
        tables.append(table)
    return tables


def _change(difference: float) -> str:
    """Return the change of a margin as text; empty if there is no margin before or after."""
    return f"{difference:+.2g}" if math.isfinite(difference) else ""


def format_poles(matrices: StateSpace) -> Table:
    """Return a table of the poles."""
    table = Table(title="Poles", title_justify="left")
    for heading in ("real / s⁻¹", "imaginary / s⁻¹", "frequency / Hz", "damping"):
        table.add_column(heading, justify="right")
    for pole, damping in zip(matrices.poles, matrices.damping, strict=True):
        if pole.imag >= 0.0:
            imaginary = f"±{pole.imag:.5g}" if pole.imag > 0.0 else "0"
            table.add_row(
                f"{pole.real:.5g}", imaginary, f"{abs(pole) / (2.0 * math.pi):.4g}", f"{damping:.4g}"
            )
    return table


def format_point(result: LinearizeResult, matrices: StateSpace) -> Table:
    """Return a table of states, inputs and outputs at the operating point."""
    where = f"steady state near t = {result.at:g} s" if result.is_steady else f"t = {result.at:g} s"
    table = Table(title=escape(f"Operating point, {where}"), title_justify="left")
    for heading in ("", "name", "value", "unit"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for kind in ("states", "inputs", "outputs"):
        for name, value in zip(getattr(matrices, kind), getattr(matrices, f"at_{kind}"), strict=True):
            table.add_row(kind.removesuffix("s"), escape(name), f"{value:.6g}", matrices.units[name])
    return table


def format_lines(result: LinearizeResult) -> list[str]:
    """Return lines on how the responses were measured."""
    if result.matrices is not None:
        return [f"Note: {text}" for text in result.remarks]
    how = "restored states" if result.rolled_back else "repeated runs, as not every FMU can restore its state"
    lines = [
        f"{name}: pulses of {m.amplitude:.3g}, nonlinearity {100.0 * m.nonlinearity:.2g} %"
        + ("" if m.step_change is None else f", change by half the step {100.0 * m.step_change:.2g} %")
        for name, m in result.responses.items()
    ]
    return [*(f"Note: {text}" for text in result.remarks), *lines, f"Measured with {how}"]

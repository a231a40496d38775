"""Gains of the CAC-type controller, and the rule for tuned ones; joint files have the numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CacGains:
    """Gains of `CacController`, with the names and units of its parameters."""

    k: tuple[float, float, float, float, float]
    varpi: tuple[float, float, float, float, float]
    m: tuple[float, float, float]
    epsilon: tuple[float, float, float, float] = (0.1, 0.1, 1.0, 1.0)
    omega_n: tuple[float, float] = (5000.0, 10000.0)
    a_max: float = 1.2
    compensate: bool = False
    internal_step: float = 2e-5
    """In s; a fifth of the fastest command filter's time constant, so that Runge-Kutta is exact to 1e-3."""
    weaken_field: bool = False


def tuned(
    k_1: float, k_2: float, m_1: float, w_c: float, varpi_2: float, L: float, a_max: float, w: float = 10000.0
) -> CacGains:
    """Return gains found by search, with both current loops at w_c in 1/s, critically damped or more.

    L is the inductance in H, `w` the natural frequency of the current's command filter in rad/s, which is
    twice that of the speed's filter.
    """
    k_c = L * w_c
    m_c = 0.1 * w_c * w_c
    return CacGains(
        k=(k_1, k_2, k_c, 1.0, k_c),
        varpi=(0.0, varpi_2, 0.0, 0.0, 0.0),
        m=(m_1, m_c, m_c),
        epsilon=(0.1, 0.01, 1.0, 1.0),
        omega_n=(0.5 * w, w),
        a_max=a_max,
        weaken_field=True,
    )

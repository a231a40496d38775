"""Gains of the CAC-type controller: as published, and tuned."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CacGains:
    """Gains of `CacController`, named as its parameters; units there."""

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


PUBLISHED = {
    "lift": CacGains(
        k=(230.0, 230.0, 0.05, 1.0, 0.05), varpi=(3.0, 3.0, 0.03, 3.0, 0.03), m=(1.0, 12.0, 1.0)
    ),
    "tilt": CacGains(
        k=(210.0, 210.0, 0.03, 1.0, 0.03), varpi=(2.0, 2.0, 0.02, 2.0, 0.02), m=(1.0, 10.5, 1.0)
    ),
    "telescope": CacGains(
        k=(175.0, 175.0, 0.03, 0.5, 0.03), varpi=(1.0, 1.0, 0.03, 1.0, 0.03), m=(0.9, 8.0, 0.9), a_max=10.0
    ),
    # none are printed for the experiments: those of the lift, whose motor comes closest
    "prototype": CacGains(
        k=(230.0, 230.0, 0.05, 1.0, 0.05),
        varpi=(3.0, 3.0, 0.03, 3.0, 0.03),
        m=(1.0, 12.0, 1.0),
        omega_n=(1000.0, 2000.0),
    ),
}
"""Table V by joint. epsilon and the filters are ours: with less epsilon the tanh terms lose tilt."""


def tuned(
    k_1: float, k_2: float, m_1: float, w_c: float, varpi_2: float, L: float, a_max: float, w: float = 10000.0
) -> CacGains:
    """Gains found by search; both current loops at w_c for an inductance L in H, critically damped or more.

    `w` is the natural frequency of the current's command filter in rad/s, twice that of the speed's.
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


TUNED = {
    "lift": tuned(515.0, 519.0, 6.09e5, 1703.0, 0.00252, L=2.4e-3, a_max=1.2),
    "tilt": tuned(307.0, 305.0, 4.95e5, 2370.0, 0.00659, L=3.2e-3, a_max=1.2),
    "telescope": tuned(401.0, 495.0, 8.81e5, 1581.0, 0.0196, L=12e-3, a_max=10.0),
    "prototype": tuned(170.0, 90.3, 9360.0, 333.0, 0.022, L=2.42e-3, a_max=1.2, w=2000.0),
}
"""What `emla tune cac-lift` and its like find; for the prototype by a search of its own.

For tilt none of the search met all conditions: these are nearest.
"""

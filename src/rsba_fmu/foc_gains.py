"""Gains of the FOC cascade: by rule, and tuned; joint files have the numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FocGains:
    """Gains of `FocController`, with the names and units of its parameters."""

    k_p: float
    k_v: float
    w_c: float
    w_i: float
    omega_d: float
    a_max: float
    compensate: bool = False


def rule(sample_time: float, observer_poles: float, a_max: float) -> FocGains:
    """Return gains by rules that are common for drives.

    Each loop gets half of what its delays allow, the magnitude optimum of a loop with one small time
    constant T: a gain of 1 / (2 T) (Kessler 1955; Leonhard, Control of Electrical Drives).

    - Currents: T is 1.5 samples, one for computing and half of one for holding the voltage.
    - Speed: T is the sum of 1 / w_c of the current loop and 2 / `observer_poles` of the observer. Speed
      controller and disturbance observer share the gain equally. Together they are a PI controller of
      gain k_v + omega_d and integral k_v omega_d.
    - Position: half of k_v, so that the damping of its loop is 1 / sqrt(2).
    - The current controllers' integrals are ten times slower than their loops.

    Args:
        sample_time: Sample time of the drive, s.
        observer_poles: Magnitude of the observer's poles, rad/s.
        a_max: Braking acceleration, m/s2.
    """
    w_c = 1.0 / (2.0 * 1.5 * sample_time)
    k_v = 0.5 / (2.0 * (1.0 / w_c + 2.0 / observer_poles))
    return FocGains(k_p=0.5 * k_v, k_v=k_v, w_c=w_c, w_i=0.1 * w_c, omega_d=k_v, a_max=a_max)


def tuned(k_p: float, k_v: float, w_c: float, a_max: float, w_i: float | None = None) -> FocGains:
    """Return gains found by search, with the observer's d_hat for the load.

    Without w_i the integrals are those of `rule`.
    """
    return FocGains(k_p, k_v, w_c, 0.1 * w_c if w_i is None else w_i, 0.0, a_max, compensate=True)

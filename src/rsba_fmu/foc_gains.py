"""Gains of the FOC cascade: by rule, and tuned; joint files have the numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FocGains:
    """Gains of `FocController`, named as its parameters; units there."""

    k_p: float
    k_v: float
    w_c: float
    w_i: float
    omega_d: float
    a_max: float
    compensate: bool = False


def rule(sample_time: float, observer_poles: float, a_max: float) -> FocGains:
    """Gains that a drive engineer would set, from the sample time in s and the observer's poles in rad/s.

    Each loop gets half of what its delays allow, the magnitude optimum of a loop with one small time
    constant T: a gain of 1 / (2 T) (Kessler 1955; Leonhard, Control of Electrical Drives).

    - Currents: T is 1.5 samples, one to compute and half of one that the voltage is held.
    - Speed: T is that loop's 1 / w_c and the observer's 2 / `observer_poles`. The gain is
      shared alike by speed controller and disturbance observer, which act as one PI controller of gain
      k_v + omega_d and integral k_v omega_d.
    - Position: half of k_v, so that its loop is damped by 1 / sqrt(2).
    - The current controllers' integrals take ten times as long as their loops.
    """
    w_c = 1.0 / (2.0 * 1.5 * sample_time)
    k_v = 0.5 / (2.0 * (1.0 / w_c + 2.0 / observer_poles))
    return FocGains(k_p=0.5 * k_v, k_v=k_v, w_c=w_c, w_i=0.1 * w_c, omega_d=k_v, a_max=a_max)


def tuned(k_p: float, k_v: float, w_c: float, a_max: float) -> FocGains:
    """Gains found by search, with the observer's d_hat for the load; the integrals as in `rule`."""
    return FocGains(k_p, k_v, w_c, 0.1 * w_c, 0.0, a_max, compensate=True)

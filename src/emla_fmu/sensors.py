"""Position and current sensors with noise and resolution: functions of the plant's values `v`."""

import math
from typing import Any

from fmublock import cos, floor, log, sin, sqrt, where
from fmublock.noise import lehmer, normal, uniform

from . import motion_law


def drawn(v: Any) -> dict[str, Any]:
    """Draw the noise of the next communication step: one value for the position, one for each current.

    The currents have their own generator, so that the position's noise does not depend on them. Sensors
    without noise draw no values.
    """
    random, noise = drawn_position(v.random, v.sigma)
    third = lehmer(v.random_i)
    fourth = lehmer(third)
    # both values of one transformation: cosine for q, sine for d
    radius, angle = sqrt(-2.0 * log(uniform(third))), 2.0 * math.pi * uniform(fourth)
    noisy_i = v.sigma_i > 0.0
    return {
        "random": random,
        "noise": noise,
        "random_i": where(noisy_i, fourth, v.random_i),
        "noise_q": where(noisy_i, radius * cos(angle), 0.0),
        "noise_d": where(noisy_i, radius * sin(angle), 0.0),
    }


def drawn_position(random: Any, sigma: Any) -> tuple[Any, Any]:
    """Return the next state of a position sensor's generator, and its draw from N(0, 1); 0 without noise.

    Args:
        random: The state of the generator.
        sigma: The standard deviation of the noise in m.
    """
    first = lehmer(random)
    second = lehmer(first)
    is_noisy = sigma > 0.0
    return where(is_noisy, second, random), where(is_noisy, normal(first, second), 0.0)


def measured_position(v: Any) -> Any:
    """Return the position in m that the encoder at the motor measures for the screw."""
    return with_noise(v, v.x_L + encoder_error(v) - travel_error(v))


def with_noise(v: Any, position: Any) -> Any:
    """Return a position in m with the noise and the resolution of the position sensor."""
    return quantized(position + v.sigma * v.noise, v.resolution)


def encoder_error(v: Any) -> Any:
    """Return the error of an eccentric encoder in m of the screw: a sine of the motor angle."""
    alpha = motion_law.alpha_RL(v)
    return where(v.eccentricity > 0.0, v.eccentricity * sin(alpha * v.x_L) / alpha, 0.0)


def travel_error(v: Any) -> Any:
    """Return by how much more the screw travels than its nominal lead says, in m; 0 at x_L = 0."""
    turn = where(v.wobble > 0.0, v.wobble * sin(2.0 * math.pi * v.x_L / v.lead), 0.0)
    return v.lead_error * v.x_L + turn


def measured_currents(v: Any) -> tuple[Any, Any]:
    """Return the measured i_q and i_d in A; noise and resolution apply to the d-q currents, after (2)."""
    i_q = quantized(v.i_q + v.sigma_i * v.noise_q, v.resolution_i)
    return i_q, quantized(v.i_d + v.sigma_i * v.noise_d, v.resolution_i)


def quantized(x: Any, resolution: Any) -> Any:
    """Round a value to a resolution; 0 is no rounding."""
    step = where(resolution > 0.0, resolution, 1.0)
    return where(resolution > 0.0, step * floor(x / step + 0.5), x)

"""The joint lift with one step of computing delay, linearised by hand from the READMEs of its FMUs.

The order is that of Gauss-Seidel: plant, observer, controller. Without friction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

STEP = 1e-4
N_P, PHI, L, R = 8, 0.15, 2.4e-3, 0.14
ALPHA = 2.0 * np.pi * 7.0 / 0.02
FRICTION = ALPHA * 1.67e-3
F_2, F_3, F_4 = 0.01, 0.002, 0.001

GAINS = {
    "rsba": {"p": 2200.0, "k_1": 1050.0, "k_2": 875.0, "k_3": 2000.0, "omega_u": 300.0},
    "foc": {"p": 1959.0, "k_p": 1464.0, "k_v": 543.0, "w_c": 2336.0, "w_i": 233.6},
    "cac": {"p": 1036.0, "k_1": 515.0, "k_2": 519.0, "m_1": 6.09e5, "w_c": 1703.0, "varpi_2": 0.00252},
}
"""Gains, mostly in 1/s: `compensated` of RSBA, `tuned` of FOC and CAC."""

_OF_CONTROLLER = {"rsba": 2, "foc": 2, "cac": 11}
"""Number of states of each controller."""

POSITION, CURRENT = "measured position", "current reference"

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class LinearDrive:
    """The linear loop of the lift at an operating point.

    Attributes:
        controller: rsba, foc or cac; cac cannot be opened at its current reference.
        v: Speed of the screw in m/s.
        i_q: q-axis current in A.
        i_d: d-axis current in A.
        inertia: Inertia of the plant relative to that of the controller's model.
    """

    controller: str
    v: float
    i_q: float
    i_d: float
    inertia: float = 1.0

    def loop_gain(self, opened_at: str, frequency: Matrix) -> NDArray[np.complex128]:
        """Return the loop gain L, positive for negative feedback."""
        A, B, C, D = self._open(opened_at)
        unit, z = np.eye(len(A)), np.exp(2j * np.pi * frequency * STEP)
        return np.array([-(C @ np.linalg.solve(x * unit - A, B) + D) for x in z])

    def is_stable(self) -> bool:
        """Return whether the closed loop is stable."""
        A, B, C, D = self._open(POSITION)
        return bool(np.abs(np.linalg.eigvals(A + np.outer(B, C) / (1.0 - D))).max() < 1.0)

    def _open(self, opened_at: str) -> tuple[Matrix, Matrix, Matrix, float]:
        """Return the matrices from the signal after the opening to that before it."""
        count = 13 + _OF_CONTROLLER[self.controller]
        columns = [self._step(state, 0.0, opened_at) for state in np.eye(count)]
        B, D = self._step(np.zeros(count), 1.0, opened_at)
        return np.array([c for c, _ in columns]).T, B, np.array([y for _, y in columns]), D

    def _step(self, state: Matrix, entering: float, opened_at: str) -> tuple[Matrix, float]:
        """Return the state after a step, and the signal before the opening."""
        plant, late, before, estimate, read, integrals = np.split(state, [4, 6, 8, 11, 13])
        A, B = self._plant()
        plant = A @ plant + B @ late
        now = np.array([entering if opened_at == POSITION else plant[0], plant[2]])
        decay, held_part, moving_part = self._observer()
        estimate = decay @ estimate + held_part @ read + moving_part @ (now - read)
        current = entering if opened_at == CURRENT else None
        law = {"rsba": self._rsba, "foc": self._foc, "cac": self._cac}[self.controller]
        voltages, integrals, demanded = law(estimate, plant[2:], integrals, before, current)
        after = np.concatenate([plant, before, voltages, estimate, now, integrals])
        return after, plant[0] if opened_at == POSITION else demanded

    @property
    def _omega(self) -> float:
        return N_P * ALPHA * self.v

    @property
    def _inertia_of_model(self) -> float:
        return ALPHA * (0.016 + 156.5 / ALPHA**2)

    def plant(self) -> tuple[Matrix, Matrix]:
        """Return the matrices of the derivatives of position, speed, i_q and i_d, with voltages as inputs."""
        inertia = self.inertia * self._inertia_of_model
        emf_q, emf_d = N_P * ALPHA * (self.i_d + PHI / L), N_P * ALPHA * self.i_q
        A = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [0.0, -(1.0 + F_2) * FRICTION / inertia, 1.5 * N_P * PHI / inertia, 0.0],
                [0.0, -(1.0 + F_3) * emf_q, -(1.0 + F_3) * R / L, -(1.0 + F_3) * self._omega],
                [0.0, (1.0 + F_4) * emf_d, (1.0 + F_4) * self._omega, -(1.0 + F_4) * R / L],
            ]
        )
        B = np.array([[0.0, 0.0], [0.0, 0.0], [1.0 / L, 0.0], [0.0, 1.0 / L]])
        return A, B

    def _plant(self) -> tuple[Matrix, Matrix]:
        """Return the matrices over a step of held voltages."""
        A, B = self.plant()
        transition = expm(STEP * np.block([[A, B], [np.zeros((2, 6))]]))
        return transition[:4, :4], transition[:4, 4:]

    def _observer(self) -> tuple[Matrix, Matrix, Matrix]:
        """Return the matrices of the observer over a step whose inputs move on straight lines."""
        p, torque = GAINS[self.controller]["p"], 1.5 * N_P * PHI / self._inertia_of_model
        A = np.array(
            [
                [-3.0 * p, 1.0, 0.0],
                [-3.0 * p * p, -FRICTION / self._inertia_of_model, 1.0],
                [-(p**3), 0.0, 0.0],
            ]
        )
        B = np.array([[3.0 * p, 0.0], [3.0 * p * p, torque], [p**3, 0.0]])
        slope = np.hstack([np.zeros((2, 5)), np.eye(2) / STEP])
        all_of = expm(STEP * np.vstack([np.hstack([A, B, np.zeros((3, 2))]), slope, np.zeros((2, 7))]))
        return all_of[:3, :3], all_of[:3, 3:5], all_of[:3, 5:]

    def _holding(self, v_hat: float, currents: Matrix) -> Matrix:
        """Return the voltages that keep the currents constant."""
        omega, (i_q, i_d) = N_P * ALPHA * v_hat, currents
        return np.array(
            [
                R * i_q + omega * (self.i_d * L + PHI) + self._omega * L * i_d,
                R * i_d - omega * self.i_q * L - self._omega * i_q * L,
            ]
        )

    def _rsba(
        self, estimate: Matrix, currents: Matrix, modelled: Matrix, before: Matrix, current: float | None
    ) -> tuple[Matrix, Matrix, float]:
        g, (x_hat, v_hat, d_hat) = GAINS["rsba"], estimate
        A_2 = 1.5 * N_P * PHI / self._inertia_of_model
        P_2 = v_hat + g["k_1"] * x_hat
        friction = FRICTION / self._inertia_of_model * v_hat
        demanded = (-g["k_2"] * P_2 - x_hat + friction - d_hat) / A_2
        error = currents - np.array([demanded if current is None else current, 0.0])
        holding, rate, decay = self._holding(v_hat, currents), g["omega_u"], np.exp(-g["omega_u"] * STEP)
        modelled = decay * modelled + (1.0 - decay) / rate * ((before - holding) / L + rate * currents)
        return holding - L * (g["k_3"] * error + rate * (currents - modelled)), modelled, demanded

    def _foc(
        self, estimate: Matrix, currents: Matrix, integrals: Matrix, _: Matrix, current: float | None
    ) -> tuple[Matrix, Matrix, float]:
        g, (x_hat, v_hat, d_hat) = GAINS["foc"], estimate
        A_2 = 1.5 * N_P * PHI / self._inertia_of_model
        friction = FRICTION / self._inertia_of_model * v_hat
        demanded = (-g["k_v"] * (g["k_p"] * x_hat + v_hat) + friction - d_hat) / A_2
        error = np.array([demanded if current is None else current, 0.0]) - currents
        integrals = integrals + STEP * g["w_i"] * g["w_c"] * error
        return L * (g["w_c"] * error + integrals) + self._holding(v_hat, currents), integrals, demanded

    def _cac(
        self, estimate: Matrix, currents: Matrix, states: Matrix, _: Matrix, __: float | None
    ) -> tuple[Matrix, Matrix, float]:
        """Integrate filters, compensation and adaptation over a step with held inputs, then give voltages."""
        g, (x_hat, v_hat, _d) = GAINS["cac"], estimate
        A_2 = 1.5 * N_P * PHI / self._inertia_of_model
        friction, k_c = FRICTION / self._inertia_of_model, g["w_c"] * L

        def rates(s: Matrix) -> list[float]:
            w, w_rate, i_c, i_rate, xi_1, xi_2, xi_3, xi_4, D_2, D_3, D_4, x, v, i_q, i_d = s
            z_2, z_3 = v - w, i_q - i_c
            v_2, v_3, v_4 = z_2 - xi_2, z_3 - xi_3, i_d - xi_4
            a_1 = -g["k_1"] * x
            robust = g["varpi_2"] / 0.01 * v_2
            a_2 = (w_rate - g["k_2"] * z_2 - x + friction * v - D_2 - robust) / A_2
            filtered = [5e3 * (5e3 * (a_1 - w) - 2.0 * w_rate), 1e4 * (1e4 * (a_2 - i_c) - 2.0 * i_rate)]
            compensation = [
                -g["k_1"] * xi_1 + w - a_1 + xi_2,
                -g["k_2"] * xi_2 + A_2 * (i_c - a_2 + xi_3) - xi_1,
                (-k_c * xi_3 - A_2 * xi_2) / L,
                -k_c / L * xi_4,
            ]
            m = np.array([g["m_1"], 0.1 * g["w_c"] ** 2, 0.1 * g["w_c"] ** 2])
            adapted = m * np.array([v_2, v_3, v_4]) - 0.01 * np.array([D_2, D_3, D_4])
            return [w_rate, filtered[0], i_rate, filtered[1], *compensation, *adapted, 0.0, 0.0, 0.0, 0.0]

        A = np.array([rates(unit) for unit in np.eye(15)]).T
        states = (expm(STEP * A) @ np.concatenate([states, [x_hat, v_hat], currents]))[:11]
        w, _, i_c, i_rate, *_, D_3, D_4 = states
        error_q, error_d = k_c * (currents[0] - i_c) + A_2 * (v_hat - w), k_c * currents[1]
        forced = np.array([L * (i_rate - D_3) - error_q, -L * D_4 - error_d])
        return self._holding(v_hat, currents) + forced, states, i_c

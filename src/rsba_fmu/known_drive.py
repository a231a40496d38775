"""The controllers' parameters of motor and load."""

from fmublock import Block, Parameter


class KnownDrive(Block):
    """Base of all controllers of an EMLA: limits of motor and inverter, and their model."""

    a_max = Parameter(1.2, unit="m/s2", minimum=1e-6, name="limit.a_max", description="Braking acceleration")
    i_max = Parameter(105.0, unit="A", minimum=1e-6, name="limit.i_max", description="Largest q-axis current")
    u_max = Parameter(445.0, unit="V", minimum=1e-6, name="limit.u_max", description="Longest voltage vector")

    R_s = Parameter(
        0.14, unit="Ohm", minimum=0.0, name="model.R_s", description="Stator resistance in the model"
    )
    L_d = Parameter(
        2.4e-3, unit="H", minimum=1e-9, name="model.L_d", description="d-axis inductance in the model"
    )
    L_q = Parameter(
        2.4e-3, unit="H", minimum=1e-9, name="model.L_q", description="q-axis inductance in the model"
    )
    Phi_PM = Parameter(
        0.15, unit="Wb", minimum=1e-9, name="model.Phi_PM", description="Magnet flux in the model"
    )
    N_p = Parameter(8, minimum=1, name="model.N_p", description="Number of pole pairs in the model")
    alpha_RL = Parameter(
        2199.0,
        unit="rad/m",
        minimum=1e-9,
        name="model.alpha_RL",
        description="Motor angle per travel in the model",
    )
    A_eq = Parameter(
        35.26, unit="kg.m", minimum=1e-9, name="model.A_eq", description="Equivalent inertia in the model"
    )
    B_eq = Parameter(
        3.67, unit="kg.m/s", minimum=0.0, name="model.B_eq", description="Equivalent friction in the model"
    )
    C_eq = Parameter(
        0.0, unit="N", minimum=0.0, name="model.C_eq", description="Torque per travel in the model"
    )

within EMLA;
block HdrmPlant "3-DoF manipulator with the mechanics of its three actuators: motor torques in, motion out"
  extends Machine;

  record Motor "Motors"
    Real m[3](each unit = "kg", each min = 0.0) = {45.0, 30.0, 12.0} "Mass, which is fixed to the housing";
    Real J_m[3](each unit = "kg.m2", each min = 0.0) = {0.016, 0.0105, 0.00085} "Rotor inertia";
    Real B_m[3](each unit = "N.m.s/rad", each min = 0.0) = fill(1.67e-3, 3) "Viscous friction of the rotor";
  end Motor;

  record Coupling "Between motors and gearboxes"
    Real J_c[3](each unit = "kg.m2", each min = 0.0) = fill(0.0, 3) "Coupling inertia";
  end Coupling;

  record Gearbox "Between couplings and screws, with the efficiency of both"
    Real rho[3](each min = 1e-9) = {1.0 / 7.0, 1.0 / 5.0, 1.0} "Screw turns per motor turn (gear ratio 1/rho)";
    Real J_GB[3](each unit = "kg.m2", each min = 0.0) = fill(0.0, 3) "Gearbox inertia at the motor";
    Real eta_GB[3](each min = 1e-3, each max = 1.0) = fill(0.9, 3) "Efficiency of gearbox and screw";
  end Gearbox;

  record Screw "From rotary to linear motion"
    Real lead[3](each unit = "m", each min = 1e-9) = {0.02, 0.01, 0.01} "Screw travel per turn";
    Real M_BS[3](each unit = "kg", each min = 0.0) = {156.5, 83.6, 30.4} "Mass of an actuator without its motor";
    Real B_BS[3](each unit = "N.s/m", each min = 0.0) = fill(0.0, 3) "Viscous friction of the screw";
    Real C_eq[3](each unit = "N", each min = 0.0) = fill(0.0, 3) "Torque per travel as printed; 0 is a rigid screw";
    Real q_LB[3](each unit = "m") = {0.0, 0.0, 0.0} "Lower end of a stroke";
    Real q_UB[3](each unit = "m") = {0.522, 0.611, 1.0} "Upper end of a stroke";
    Real v_max[3](each unit = "m/s", each min = 0.0) = {0.136, 0.1, 0.21} "Largest speed of the screw";
  end Screw;

  record Uncertainty "(84)"
    Real F_2[3] = fill(0.0, 3) "Modelling error of g_2 as a fraction (84)";
  end Uncertainty;

  record Start "Where the motion begins"
    Real x_L[3](each unit = "m") = {0.244, 0.389, 0.499} "Initial screw position";
    Real v_L[3](each unit = "m/s") = fill(0.0, 3) "Initial screw speed";
  end Start;

  Interfaces.RealInput tau_m[3](each unit = "N.m", each nominal = 10.0) "Motor torque that drives the screw"
    annotation(Placement(transformation(extent = {{-120, 60}, {-100, 80}})));
  Interfaces.RealInput d_2[3](each unit = "m/s2") "Disturbance of the screw's acceleration"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  parameter Motor motor "Motors";
  parameter Coupling coupling "Couplings";
  parameter Gearbox gearbox "Gearboxes";
  parameter Screw screw "Screws";
  parameter Uncertainty uncertainty "Uncertainty of the model";
  parameter Start start "Start";
  Interfaces.RealOutput x_L[3](start = start.x_L, each fixed = true, each unit = "m", each nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{100, 80}, {120, 100}})));
  Interfaces.RealOutput v_L[3](start = start.v_L, each fixed = true, each unit = "m/s", each nominal = 0.1) "Screw speed"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput a_L[3](each unit = "m/s2") "Screw acceleration"
    annotation(Placement(transformation(extent = {{100, 0}, {120, 20}})));
  Interfaces.RealOutput F_L[3](each unit = "N", each nominal = 1e4) "Load force, positive against extension"
    annotation(Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Interfaces.RealOutput energy(unit = "J", nominal = 1e4) "Energy of machine and actuators; potential energy relative to 0"
    annotation(Placement(transformation(extent = {{100, -80}, {120, -60}})));
protected
  final parameter Real alpha[3](each unit = "rad/m") = {Functions.alpha_RL(gearbox.rho[1], screw.lead[1]), Functions.alpha_RL(gearbox.rho[2], screw.lead[2]), Functions.alpha_RL(gearbox.rho[3], screw.lead[3])} "Motor angle per travel";
  final parameter Real A_eq[3](each unit = "kg.m") =
    {Functions.A_eq(alpha[1], motor.J_m[1] + coupling.J_c[1] + gearbox.J_GB[1], screw.M_BS[1]), Functions.A_eq(alpha[2], motor.J_m[2] + coupling.J_c[2] + gearbox.J_GB[2], screw.M_BS[2]), Functions.A_eq(alpha[3], motor.J_m[3] + coupling.J_c[3] + gearbox.J_GB[3], screw.M_BS[3])} "Equivalent inertia";
  final parameter Real B_eq[3](each unit = "kg.m/s") = {Functions.B_eq(alpha[1], motor.B_m[1], screw.B_BS[1]), Functions.B_eq(alpha[2], motor.B_m[2], screw.B_BS[2]), Functions.B_eq(alpha[3], motor.B_m[3], screw.B_BS[3])} "Equivalent friction";
  final parameter Real D_eq[3](each unit = "m") = {Functions.D_eq(alpha[1], gearbox.eta_GB[1]), Functions.D_eq(alpha[2], gearbox.eta_GB[2]), Functions.D_eq(alpha[3], gearbox.eta_GB[3])} "Motor torque per load force";
  Real G[2](each unit = "rad/m") "Booms' angles per stroke";
  Real K[2](each unit = "rad/m") "Actuators' angles per stroke";
  Real lever_b(unit = "m") "O2 along the outer boom";
  Real lever_a(unit = "m") "A2 along the tilt actuator";
  Real M_11(unit = "kg") "Inertia of the lift";
  Real M_21(unit = "kg") "Between lift and tilt";
  Real M_22(unit = "kg") "Inertia of the tilt";
  Real M_31(unit = "kg") "Between lift and telescope";
  Real M_33(unit = "kg") "Inertia of the telescope";
  Real p[3](each unit = "N") "Forces that accelerate";
  Real I[3](each unit = "kg") "Inertia of each stroke with that of its actuator";
  Real y_2(unit = "N") "What lift leaves to the tilt";
  Real D_2(unit = "kg") "Inertia of the tilt with the lift free";
  Real l_32 "Share of the tilt in the telescope";
  Real D_3(unit = "kg") "Inertia of the telescope with lift and tilt free";
equation
  for i in 1:3 loop
    q[i] = x_L[i];
    v[i] = v_L[i];
    a[i] = 0.0;
    M_BS[i] = screw.M_BS[i];
    m_motor[i] = motor.m[i];
    der(x_L[i]) = v_L[i];
    der(v_L[i]) = a_L[i];
    p[i] = (tau_m[i] - (1.0 + uncertainty.F_2[i]) * (B_eq[i] * v_L[i] + screw.C_eq[i] * x_L[i]) + A_eq[i] * d_2[i]) / D_eq[i] - f[i];
  end for;

  // mass matrix, from the kinetic energy
  for i in 1:2 loop
    G[i] = 1.0 / r[i];
    K[i] = d[i] / L[i] / r[i];
  end for;
  lever_b = e_2[1] * O_2[1] + e_2[2] * O_2[2];
  lever_a = u_2[1] * A_2[1] + u_2[2] * A_2[2];
  M_11 = G[1] ^ 2 * (J_l + m_b * (O_2[1] ^ 2 + O_2[2] ^ 2) + 2.0 * S_b * lever_b + J_b
    + m_a * (A_2[1] ^ 2 + A_2[2] ^ 2) + 2.0 * S_a[2] * lever_a + J_a[2]) + K[1] ^ 2 * J_a[1];
  M_21 = G[1] * (G[2] * (S_b * lever_b + J_b) + K[2] * (S_a[2] * lever_a + J_a[2]) + m_t[2] * (A_2[1] * u_2[2] - A_2[2] * u_2[1]));
  M_22 = G[2] ^ 2 * J_b + K[2] ^ 2 * J_a[2];
  M_31 = G[1] * m_s * (O_2[1] * e_2[2] - O_2[2] * e_2[1]);
  M_33 = m_s - m_t[3];

  // (M + diag(A_eq / D_eq)) a_L = p
  I[1] = M_11 + A_eq[1] / D_eq[1];
  I[2] = M_22 + A_eq[2] / D_eq[2];
  I[3] = M_33 + A_eq[3] / D_eq[3];
  D_2 = I[2] - M_21 ^ 2 / I[1];
  l_32 = -M_31 * M_21 / I[1] / D_2;
  D_3 = I[3] - M_31 ^ 2 / I[1] - l_32 ^ 2 * D_2;
  y_2 = p[2] - M_21 / I[1] * p[1];
  a_L[3] = (p[3] - M_31 / I[1] * p[1] - l_32 * y_2) / D_3;
  a_L[2] = y_2 / D_2 - l_32 * a_L[3];
  a_L[1] = (p[1] - M_21 * a_L[2] - M_31 * a_L[3]) / I[1];
  F_L[1] = M_11 * a_L[1] + M_21 * a_L[2] + M_31 * a_L[3] + f[1];
  F_L[2] = M_21 * a_L[1] + M_22 * a_L[2] + f[2];
  F_L[3] = M_31 * a_L[1] + M_33 * a_L[3] + f[3];
  energy = 0.5 * (I[1] * v_L[1] ^ 2 + I[2] * v_L[2] ^ 2 + I[3] * v_L[3] ^ 2) + M_21 * v_L[1] * v_L[2] + M_31 * v_L[1] * v_L[3]
    + gravity * (lift_boom.m * lift_boom.c * e_1[2] + m_b * O_2[2] + S_b * e_2[2] + (m_h[1] + m_t[1]) * A_1[2]
    + S_a[1] * u_1[2] + m_a * A_2[2] + S_a[2] * u_2[2]);

  // what leaves its range says so
  for i in 1:3 loop
    assert(x_L[i] >= screw.q_LB[i] and x_L[i] <= screw.q_UB[i], "x_L left its range", AssertionLevel.warning);
    assert(abs(v_L[i]) <= screw.v_max[i], "v_L left its range", AssertionLevel.warning);
  end for;
  annotation(Icon(graphics = {
    Line(points = {{-60, -60}, {0, 20}, {60, -20}}, color = {60, 60, 60}, thickness = 2.0),
    Text(extent = {{-90, -65}, {90, -90}}, textString = "merged", lineColor = {60, 60, 60})}));
end HdrmPlant;

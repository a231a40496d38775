within EMLA;
partial block Machine "Lift boom, outer boom and telescoping inner boom, moved by three actuators"
  extends Interfaces.Block;

  record Chain "Triangle of a turning actuator: turning point, fixed pin, boom pin"
    Real a(unit = "m", min = 1e-3) = 1.15 "Distance of the fixed pin from the turning point";
    Real b(unit = "m", min = 1e-3) = 0.42 "Distance of the boom pin from the turning point";
    Real L_0(unit = "m", min = 1e-3) = 0.85 "Distance of the pins at stroke 0";
    Real delta(unit = "rad") = -70.0 * pi / 180.0 "Direction of the fixed pin relative to the carrier of the turning point";
    Real epsilon(unit = "rad") = -10.0 * pi / 180.0 "Direction of the boom pin relative to the boom";
  end Chain;

  record LiftBoom "From O1 to O2"
    Real length(unit = "m", min = 1e-3) = 1.8 "Length from O1 to O2";
    Real m(unit = "kg", min = 0.0) = 160.0 "Mass";
    Real c(unit = "m") = 0.85 "Centre of mass from O1";
    Real J(unit = "kg.m2", min = 0.0) = 43.2 "Inertia about the centre of mass";
  end LiftBoom;

  record OuterBoom "Turns about O2"
    Real m(unit = "kg", min = 0.0) = 120.0 "Mass";
    Real c(unit = "m") = 0.65 "Centre of mass from O2";
    Real J(unit = "kg.m2", min = 0.0) = 22.5 "Inertia about the centre of mass";
  end OuterBoom;

  record InnerBoom "Slides in the outer boom"
    Real reach(unit = "m", min = 1e-3) = 1.65 "Distance of the tip from O2 at stroke 0";
    Real m(unit = "kg", min = 0.0) = 60.0 "Mass";
    Real c(unit = "m") = 0.75 "Centre of mass behind the tip";
    Real J(unit = "kg.m2", min = 0.0) = 11.25 "Inertia about the centre of mass";
  end InnerBoom;

  record Payload "At the tip"
    Real J(unit = "m2", min = 0.0) = 0.06 "Inertia about the tip per mass";
  end Payload;

  record Housing "Housings with their motors"
    Real c[3](each unit = "m") = {0.34, 0.40, 0.50} "Centre of mass of housing and motor from the fixed pin (telescope: from O2)";
    Real J[3](each unit = "kg.m2", each min = 0.0) = {9.3, 7.4, 2.8} "Inertia of housing and motor about their centre of mass";
  end Housing;

  record Tube "Tubes"
    Real share(min = 0.0, max = 1.0) = 0.3 "Fraction of M_BS in the tube, which moves with the screw";
    Real c[3](each unit = "m") = {0.34, 0.40, 0.75} "Centre of mass of the tube behind the boom pin (telescope: behind the tip)";
    Real J[3](each unit = "kg.m2", each min = 0.0) = {2.8, 2.1, 0.8} "Inertia of the tube about its centre of mass";
  end Tube;

  record Tip "Where the payload is"
    Real x(unit = "m") "Horizontal position of the payload";
    Real y(unit = "m") "Height of the payload";
  end Tip;

  Interfaces.RealInput payload_m(unit = "kg", nominal = 100.0, min = 0.0) "Mass of the payload"
    annotation(Placement(transformation(extent = {{-120, -100}, {-100, -80}})));

  parameter Chain lift "Lift";
  parameter Chain tilt(a = 1.25, b = 0.45, L_0 = 1.0, delta = -170.0 * pi / 180.0, epsilon = -20.0 * pi / 180.0) "Tilt";
  parameter LiftBoom lift_boom "Lift boom";
  parameter OuterBoom outer_boom "Outer boom";
  parameter InnerBoom inner_boom "Inner boom";
  parameter Payload payload "Payload";
  parameter Housing housing "Housings";
  parameter Tube tube "Tubes";
  parameter Real gravity(unit = "m/s2") = 9.81 "Gravitational acceleration";
  Tip tip "Tip";
protected
  // what the blocks give, and what they take
  Real q[3](each unit = "m") "Strokes";
  Real v[3](each unit = "m/s") "Speeds of the strokes";
  Real a[3](each unit = "m/s2") "Accelerations of the strokes";
  Real M_BS[3](each unit = "kg") "Masses of the actuators without their motors";
  Real m_motor[3](each unit = "kg") "Masses of the motors";
  Real f[3](each unit = "N") "Forces that the motion takes";
  // triangles of lift and tilt
  Real L[2](each unit = "m") "Lengths of the actuators";
  Real gamma[2](each unit = "rad") "Angles between the pins";
  Real r[2](each unit = "m") "Lever arms";
  Real d[2](each unit = "m") "From the boom pin to the lever arm's foot";
  Real rate[2](each unit = "rad/s") "Speeds of the angles between the pins";
  Real growth[2](each unit = "rad/s2") "Their accelerations";
  Real swing[2](each unit = "rad/s") "Speeds of the actuators about their fixed pins";
  Real swung[2](each unit = "rad/s2") "Their accelerations";
  // directions, places from O1, turning
  Real theta_1(unit = "rad") "Angle of the lift boom";
  Real theta_2(unit = "rad") "Angle of the outer boom, also against the horizontal";
  Real e_1[2] "Direction of the lift boom";
  Real e_2[2] "Direction of outer and inner boom";
  Real u_1[2] "Direction of the lift actuator";
  Real u_2[2] "Direction of the tilt actuator";
  Real O_2[2](each unit = "m") "Turning point of the outer boom";
  Real A_1[2](each unit = "m") "Fixed pin of the lift actuator";
  Real A_2[2](each unit = "m") "Fixed pin of the tilt actuator";
  Real omega_2(unit = "rad/s") "Turning of the outer boom";
  Real alpha_2(unit = "rad/s2") "Its acceleration";
  Real omega_t(unit = "rad/s") "Turning of the tilt actuator";
  Real alpha_t(unit = "rad/s2") "Its acceleration";
  Real a_O2[2](each unit = "m/s2") "Acceleration of O2, with the base accelerating upwards";
  Real a_A2[2](each unit = "m/s2") "Acceleration of A2, with the base accelerating upwards";
  // masses along the axes and their moments about the axes' origins; s: what slides
  Real m_h[3](each unit = "kg") "Housings with motors";
  Real m_t[3](each unit = "kg") "Tubes";
  Real s_t[3](each unit = "m") "Places of the tubes";
  Real l(unit = "m") "Place of the tip";
  Real J_l(unit = "kg.m2") "Inertia of the lift boom about O1";
  Real m_b(unit = "kg") "All on the outer boom's axis";
  Real S_b(unit = "kg.m") "All on the outer boom's axis";
  Real J_b(unit = "kg.m2") "All on the outer boom's axis";
  Real m_s(unit = "kg") "What slides in the outer boom";
  Real S_s(unit = "kg.m") "What slides in the outer boom";
  Real m_a(unit = "kg") "Tilt actuator";
  Real S_a[2](each unit = "kg.m") "Lift and tilt actuator";
  Real J_a[2](each unit = "kg.m2") "Lift and tilt actuator";
  // what motion takes
  Real F_b[2](each unit = "N") "Force of all on the outer boom's axis";
  Real N_b(unit = "N.m") "Its moment about O2";
  Real F_a[2](each unit = "N") "Force of the tilt actuator";
  Real N_a[2](each unit = "N.m") "Moments of lift and tilt actuator about their fixed pins";
  Real N_1(unit = "N.m") "Moment of all that the lift boom carries about O1";
equation
  // triangles: cos gamma = (a^2 + b^2 - L^2) / (2 a b)
  L[1] = lift.L_0 + q[1];
  L[2] = tilt.L_0 + q[2];
  gamma[1] = acos((lift.a ^ 2 + lift.b ^ 2 - L[1] ^ 2) / (2.0 * lift.a * lift.b));
  gamma[2] = acos((tilt.a ^ 2 + tilt.b ^ 2 - L[2] ^ 2) / (2.0 * tilt.a * tilt.b));
  r[1] = lift.a * lift.b * sin(gamma[1]) / L[1];
  r[2] = tilt.a * tilt.b * sin(gamma[2]) / L[2];
  d[1] = (L[1] ^ 2 + lift.b ^ 2 - lift.a ^ 2) / (2.0 * L[1]);
  d[2] = (L[2] ^ 2 + tilt.b ^ 2 - tilt.a ^ 2) / (2.0 * L[2]);
  for i in 1:2 loop
    rate[i] = v[i] / r[i];
    growth[i] = (a[i] + d[i] * (1.0 - d[i] / L[i]) * rate[i] ^ 2) / r[i];
    swing[i] = rate[i] * d[i] / L[i];
    swung[i] = (growth[i] * d[i] + v[i] * (rate[i] - 2.0 * swing[i])) / L[i];
  end for;

  // directions and places
  theta_1 = lift.delta + gamma[1] - lift.epsilon;
  theta_2 = theta_1 + tilt.delta + gamma[2] - tilt.epsilon;
  e_1[1] = cos(theta_1);
  e_1[2] = sin(theta_1);
  e_2[1] = cos(theta_2);
  e_2[2] = sin(theta_2);
  O_2[1] = lift_boom.length * e_1[1];
  O_2[2] = lift_boom.length * e_1[2];
  A_1[1] = lift.a * cos(lift.delta);
  A_1[2] = lift.a * sin(lift.delta);
  A_2[1] = O_2[1] + tilt.a * cos(theta_1 + tilt.delta);
  A_2[2] = O_2[2] + tilt.a * sin(theta_1 + tilt.delta);
  u_1[1] = (lift.b * cos(theta_1 + lift.epsilon) - A_1[1]) / L[1];
  u_1[2] = (lift.b * sin(theta_1 + lift.epsilon) - A_1[2]) / L[1];
  u_2[1] = (O_2[1] + tilt.b * cos(theta_2 + tilt.epsilon) - A_2[1]) / L[2];
  u_2[2] = (O_2[2] + tilt.b * sin(theta_2 + tilt.epsilon) - A_2[2]) / L[2];
  tip.x = O_2[1] + l * e_2[1];
  tip.y = O_2[2] + l * e_2[2];

  // outwards: accelerations
  omega_2 = rate[1] + rate[2];
  alpha_2 = growth[1] + growth[2];
  omega_t = rate[1] + swing[2];
  alpha_t = growth[1] + swung[2];
  a_O2[1] = -growth[1] * O_2[2] - rate[1] ^ 2 * O_2[1];
  a_O2[2] = gravity + growth[1] * O_2[1] - rate[1] ^ 2 * O_2[2];
  a_A2[1] = -growth[1] * A_2[2] - rate[1] ^ 2 * A_2[1];
  a_A2[2] = gravity + growth[1] * A_2[1] - rate[1] ^ 2 * A_2[2];

  // masses
  for i in 1:3 loop
    m_t[i] = tube.share * M_BS[i];
    m_h[i] = M_BS[i] - m_t[i] + m_motor[i];
  end for;
  l = inner_boom.reach + q[3];
  s_t[1] = L[1] - tube.c[1];
  s_t[2] = L[2] - tube.c[2];
  s_t[3] = l - tube.c[3];
  J_l = lift_boom.J + lift_boom.m * lift_boom.c ^ 2;
  m_s = inner_boom.m + payload_m + m_t[3];
  S_s = inner_boom.m * (l - inner_boom.c) + payload_m * l + m_t[3] * s_t[3];
  m_b = outer_boom.m + m_h[3] + m_s;
  S_b = outer_boom.m * outer_boom.c + m_h[3] * housing.c[3] + S_s;
  J_b = outer_boom.J + outer_boom.m * outer_boom.c ^ 2 + housing.J[3] + m_h[3] * housing.c[3] ^ 2
    + inner_boom.J + inner_boom.m * (l - inner_boom.c) ^ 2 + payload_m * (payload.J + l ^ 2) + tube.J[3] + m_t[3] * s_t[3] ^ 2;
  m_a = m_h[2] + m_t[2];
  for i in 1:2 loop
    S_a[i] = m_h[i] * housing.c[i] + m_t[i] * s_t[i];
    J_a[i] = housing.J[i] + m_h[i] * housing.c[i] ^ 2 + tube.J[i] + m_t[i] * s_t[i] ^ 2;
  end for;

  // inwards: forces and moments
  F_b[1] = m_b * a_O2[1] + (m_s * a[3] - S_b * omega_2 ^ 2) * e_2[1] - (S_b * alpha_2 + 2.0 * m_s * omega_2 * v[3]) * e_2[2];
  F_b[2] = m_b * a_O2[2] + (m_s * a[3] - S_b * omega_2 ^ 2) * e_2[2] + (S_b * alpha_2 + 2.0 * m_s * omega_2 * v[3]) * e_2[1];
  N_b = S_b * (e_2[1] * a_O2[2] - e_2[2] * a_O2[1]) + J_b * alpha_2 + 2.0 * S_s * omega_2 * v[3];
  F_a[1] = m_a * a_A2[1] + (m_t[2] * a[2] - S_a[2] * omega_t ^ 2) * u_2[1] - (S_a[2] * alpha_t + 2.0 * m_t[2] * omega_t * v[2]) * u_2[2];
  F_a[2] = m_a * a_A2[2] + (m_t[2] * a[2] - S_a[2] * omega_t ^ 2) * u_2[2] + (S_a[2] * alpha_t + 2.0 * m_t[2] * omega_t * v[2]) * u_2[1];
  N_a[1] = S_a[1] * u_1[1] * gravity + J_a[1] * swung[1] + 2.0 * m_t[1] * s_t[1] * swing[1] * v[1];
  N_a[2] = S_a[2] * (u_2[1] * a_A2[2] - u_2[2] * a_A2[1]) + J_a[2] * alpha_t + 2.0 * m_t[2] * s_t[2] * omega_t * v[2];
  N_1 = lift_boom.m * lift_boom.c * e_1[1] * gravity + J_l * growth[1] + N_b + O_2[1] * F_b[2] - O_2[2] * F_b[1]
    + N_a[2] + A_2[1] * F_a[2] - A_2[2] * F_a[1];
  f[1] = (N_1 + d[1] / L[1] * N_a[1]) / r[1] + m_t[1] * u_1[2] * gravity - m_t[1] * s_t[1] * swing[1] ^ 2;
  f[2] = (N_b + d[2] / L[2] * N_a[2]) / r[2] + m_t[2] * (u_2[1] * a_A2[1] + u_2[2] * a_A2[2]) - m_t[2] * s_t[2] * omega_t ^ 2;
  f[3] = m_s * (e_2[1] * a_O2[1] + e_2[2] * a_O2[2]) - S_s * omega_2 ^ 2 + (m_s - m_t[3]) * a[3];
  annotation(Documentation(info = "<html>
<p>Closed chains and recursive Newton-Euler inverse dynamics, as in the FMU <code>HdrmManipulator</code>: outwards the
accelerations, with the base accelerating upwards instead of gravity, inwards the forces and moments. The tubes' inertia
along the screws is that of A_eq and left out here. All numbers but M_BS, strokes and payload are assumptions.</p>
</html>"));
end Machine;

within EMLA;
block RsbaController "Robust subsystem-based adaptive (RSBA) control of one EMLA"
  extends Interfaces.Block;

  record Limit "What motor, inverter and load allow"
    Real a_max(unit = "m/s2", min = 1e-6) = 1.2 "Braking acceleration";
    Real i_max(unit = "A", min = 1e-6) = 105.0 "Largest q-axis current";
    Real u_max(unit = "V", min = 1e-6) = 445.0 "Longest voltage vector";
    Real v_max(unit = "m/s", min = 1e-9) = 0.136 "Largest screw speed";
    Real u_reserve(min = 0.0, max = 0.9) = 0.1 "Fraction of the voltage that weaken_field reserves for changes of current";
    Real i_reserve(min = 0.0, max = 0.9) = 0.0 "Fraction of i_max reserved for noise and delay";
    Real theta_max(min = 0.0) = 1e6 "Largest adaptation parameter";
    Real band(min = 1e-9) = 1e-3 "Excess of the limit, as a fraction, over which adaptation comes to a stop; 0 in the FMU";
  end Limit;

  record Known "The actuator as the controller knows it"
    Real R_s(unit = "Ohm", min = 0.0) = 0.14 "Stator resistance in the model";
    Real L_d(unit = "H", min = 1e-9) = 2.4e-3 "d-axis inductance in the model";
    Real L_q(unit = "H", min = 1e-9) = 2.4e-3 "q-axis inductance in the model";
    Real Phi_PM(unit = "Wb", min = 1e-9) = 0.15 "Magnet flux in the model";
    Integer N_p(min = 1) = 8 "Number of pole pairs in the model";
    Real alpha_RL(unit = "rad/m", min = 1e-9) = 2199.0 "Motor angle per travel in the model";
    Real A_eq(unit = "kg.m", min = 1e-9) = 35.26 "Equivalent inertia in the model";
    Real B_eq(unit = "kg.m/s", min = 0.0) = 3.67 "Equivalent friction in the model";
    Real C_eq(unit = "N", min = 0.0) = 0.0 "Torque per travel in the model";
  end Known;

  record Solver "Only to approach theta_max as the FMU does"
    Real internal_step(unit = "s", min = 1e-9) = 5e-5 "Time that theta would at least take to theta_max, with freeze_adaptation";
  end Solver;

  Interfaces.RealInput x_hat(unit = "m", nominal = 0.1) "Estimated screw position x_1"
    annotation(Placement(transformation(extent = {{-120, 80}, {-100, 100}})));
  Interfaces.RealInput v_hat(unit = "m/s", nominal = 0.1) "Estimated screw speed x_2"
    annotation(Placement(transformation(extent = {{-120, 50}, {-100, 70}})));
  Interfaces.RealInput i_q(unit = "A", nominal = 10.0) "Measured q-axis current x_3"
    annotation(Placement(transformation(extent = {{-120, 20}, {-100, 40}})));
  Interfaces.RealInput i_d(unit = "A", nominal = 10.0) "Measured d-axis current x_4"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealInput x_d(unit = "m", nominal = 0.1) "Reference position x_1d"
    annotation(Placement(transformation(extent = {{-120, -40}, {-100, -20}})));
  Interfaces.RealInput v_d(unit = "m/s", nominal = 0.1) "Reference speed x_2d"
    annotation(Placement(transformation(extent = {{-120, -70}, {-100, -50}})));
  Interfaces.RealInput a_d(unit = "m/s2") "Reference acceleration, used with feed_acceleration"
    annotation(Placement(transformation(extent = {{-120, -100}, {-100, -80}})));
  Interfaces.RealInput d_hat(unit = "m/s2") "Estimated disturbance of the screw's acceleration, used with compensate"
    annotation(Placement(transformation(extent = {{-120, -120}, {-100, -100}})));
  Interfaces.RealInput u_available(unit = "V", nominal = 100.0) "Longest voltage vector that the supply allows, used with measure_supply"
    annotation(Placement(transformation(extent = {{-120, 100}, {-100, 120}})));

  parameter Real beta[4](each unit = "1/s", each min = 1e-9) = {3000.0, 3000.0, 1000.0, 1000.0} "Feedback gain";
  parameter Real zeta[4](each min = 0.0) = {100.0, 100.0, 100.0, 100.0} "Gain of the adaptation in feedback and in (32)";
  parameter Real delta[4](each min = 0.0) = {100.0, 100.0, 110.0, 110.0} "Adaptation rate of (32)";
  parameter Real sigma[4](each min = 0.0) = {0.001, 0.001, 0.01, 0.01} "Adaptation leak of (32)";

  parameter Boolean x_2d_in_a_1 = true "Keep -x_2d in (31), as printed; the position then lags";
  parameter Boolean feed_acceleration = false "Add a_d / A_2 to (39)";
  parameter Boolean limit_acceleration = false "Keep the approach speed to what a_max can brake";
  parameter Boolean limit_current = false "Keep i_q* within i_max";
  parameter Boolean limit_voltage = false "Keep the voltage vector within u_max";
  parameter Boolean freeze_adaptation = false "Stop adapting while saturated and at theta_max";
  parameter Boolean limit_speed = false "Keep the approach within v_max and the base speed";
  parameter Boolean compensate = false "Subtract d_hat / A_2 from u_2";
  parameter Boolean weaken_field = false "Use i_d < 0 when the back-EMF requires it";
  parameter Boolean measure_supply = false "Use u_available as the voltage limit";
  parameter Real omega_u(unit = "1/s", min = 0.0) = 0.0 "Bandwidth of the estimated voltage disturbances d_3 and d_4; 0 is none";
  parameter Limit limit "Limits";
  parameter Known known "The actuator as the controller knows it";
  parameter Solver solver "Approach to theta_max";

  Interfaces.RealOutput theta[4](each start = 0.0, each fixed = true, each min = 0.0) "Adaptation parameter theta_hat"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  Interfaces.RealOutput z_q(start = 0.0, fixed = true, unit = "A") "q-axis current that the known voltages would make"
    annotation(Placement(transformation(extent = {{100, -110}, {120, -90}})));
  Interfaces.RealOutput z_d(start = 0.0, fixed = true, unit = "A") "d-axis current that the known voltages would make"
    annotation(Placement(transformation(extent = {{100, -130}, {120, -110}})));
  Interfaces.RealOutput u_q(unit = "V", nominal = 100.0) "q-axis voltage u_3"
    annotation(Placement(transformation(extent = {{100, 80}, {120, 100}})));
  Interfaces.RealOutput u_d(unit = "V", nominal = 100.0) "d-axis voltage u_4"
    annotation(Placement(transformation(extent = {{100, 50}, {120, 70}})));
  Interfaces.RealOutput i_q_ref(unit = "A", nominal = 10.0) "Commanded q-axis current i_q* = u_2"
    annotation(Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Interfaces.RealOutput saturated "1 while current or voltage is at its limit"
    annotation(Placement(transformation(extent = {{100, -20}, {120, 0}})));
  Interfaces.RealOutput P[4](unit = {"m", "m/s", "A", "A"}) "Tracking forms of position, speed and currents (30)"
    annotation(Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  // Table I; A_1 = 1 and g_1 = 0
  final parameter Real A_2 = 1.5 * known.N_p * known.Phi_PM / known.A_eq;
  final parameter Real A_3 = 1.0 / known.L_q;
  final parameter Real A_4 = 1.0 / known.L_d;
  Real omega_e(unit = "rad/s") "Electrical angular frequency";
  Real g_2(unit = "m/s2");
  Real g_3(unit = "A/s");
  Real g_4(unit = "A/s");
  Real gain[4](each unit = "1/s") "(beta_i + zeta_i theta_hat_i) / 2";
  Real linear_range(unit = "m") "Error up to which the approach speed is linear";
  Real approach_speed(unit = "m/s") "First term of -a_1, or what a_max can brake where that is less";
  Real u_limit(unit = "V") "Longest voltage vector, as known or measured";
  Real base_speed(unit = "m/s") "Speed up to which u_limit drives i_max without a weakened field";
  Real fastest(unit = "m/s") "Speed that reference and approach may have together";
  Real wanted(unit = "m/s") "First term of a_1";
  Real psi(unit = "Wb") "Longest flux linkage that the voltage turns";
  Real i_d_weakest(unit = "A") "Most negative i_d*";
  Real i_reachable(unit = "A") "i_q that the voltage holds with the weakest field";
  Real i_d_ref(unit = "A") "Commanded d-axis current";
  Real i_limit(unit = "A") "Largest i_q*";
  final parameter Real i_motor(unit = "A") = (1.0 - limit.i_reserve) * limit.i_max;
  Real d_3(unit = "A/s") "Estimated voltage disturbance over L_q";
  Real d_4(unit = "A/s") "Estimated voltage disturbance over L_d";
  Real a_1(unit = "m/s") "Virtual control (31)";
  Real u_2(unit = "A") "(39) before the limit";
  Real u_3(unit = "V") "(39) before the limit";
  Real u_4(unit = "V") "(39) before the limit";
  Real scale "Factor on the voltage vector";
  Real current_excess "By how much more than the limit is asked for, as a fraction";
  Real voltage_excess "By how much more than the limit is asked for, as a fraction";
  Real current_frozen "0 within the current's limit, 1 clearly beyond it";
  Real voltage_frozen "0 within the voltage's limit, 1 clearly beyond it";
  Real frozen[4] "1 while theta_hat_i shall not move";
  Real growth[4](each unit = "1/s") "(32)";
equation
  omega_e = known.N_p * known.alpha_RL * v_hat;
  g_2 = (1.5 * known.N_p * i_q * i_d * (known.L_d - known.L_q) - known.B_eq * v_hat - known.C_eq * x_hat) / known.A_eq;
  g_3 = (-known.R_s * i_q - omega_e * (i_d * known.L_d + known.Phi_PM)) / known.L_q;
  g_4 = (-known.R_s * i_d + omega_e * i_q * known.L_q) / known.L_d;

  for i in 1:4 loop
    gain[i] = 0.5 * (beta[i] + zeta[i] * theta[i]);
  end for;

  // tracking forms (27), (30)
  P[1] = x_hat - x_d;
  P[2] = v_hat - v_d - a_1;
  P[3] = i_q - i_q_ref;
  P[4] = i_d - i_d_ref;

  // virtual control (31); beyond linear_range the braking parabola lies below the line
  linear_range = limit.a_max / (gain[1] * gain[1]);
  approach_speed = noEvent(
    if limit_acceleration and abs(P[1]) > linear_range
    then (if P[1] > 0.0 then 1.0 else -1.0) * sqrt(2.0 * limit.a_max * (abs(P[1]) - 0.5 * linear_range))
    else gain[1] * P[1]);
  u_limit = if measure_supply then noEvent(max(min(u_available, limit.u_max), 1e-3)) else limit.u_max;
  base_speed = u_limit / (known.N_p * known.alpha_RL * sqrt(known.Phi_PM ^ 2 + (known.L_q * limit.i_max) ^ 2));
  fastest = noEvent(max(min(0.95 * limit.v_max, base_speed), 1.02 * abs(v_d)));
  wanted = if limit_speed then Functions.clamp(v_d - approach_speed, -fastest, fastest) - v_d else -approach_speed;
  a_1 = wanted - (if x_2d_in_a_1 then v_d else 0.0);

  // control signals (39)
  d_3 = omega_u * (i_q - z_q);
  d_4 = omega_u * (i_d - z_d);
  u_2 = (-gain[2] * P[2] - P[1] - g_2 + (if feed_acceleration then a_d else 0.0) - (if compensate then d_hat else 0.0)) / A_2;
  u_3 = (-gain[3] * P[3] - g_3 - d_3) / A_3;
  u_4 = (-gain[4] * P[4] - g_4 - d_4) / A_4;
  der(z_q) = if omega_u > 0.0 then A_3 * u_q + g_3 + d_3 else 0.0;
  der(z_d) = if omega_u > 0.0 then A_4 * u_d + g_4 + d_4 else 0.0;

  // field: L_q i_q and Phi_PM + L_d i_d within the flux that the voltage turns
  psi = (1.0 - limit.u_reserve) * u_limit / noEvent(max(abs(omega_e), 1e-6));
  i_d_weakest = -min(known.Phi_PM / known.L_d, 0.7 * limit.i_max);
  i_reachable = noEvent(sqrt(max(psi ^ 2 - (known.Phi_PM + known.L_d * i_d_weakest) ^ 2, 0.01 * psi ^ 2))) / known.L_q;
  i_d_ref = if weaken_field
    then Functions.clamp((noEvent(sqrt(max(psi ^ 2 - (known.L_q * i_q_ref) ^ 2, 1e-4 * psi ^ 2))) - known.Phi_PM) / known.L_d, i_d_weakest, 0.0)
    else 0.0;
  i_limit = if weaken_field then noEvent(min(i_motor, i_reachable)) else i_motor;

  i_q_ref = if limit_current then Functions.clamp(u_2, -i_limit, i_limit) else u_2;
  scale = if limit_voltage then Functions.shortening(u_3, u_4, u_limit) else 1.0;
  u_q = scale * u_3;
  u_d = scale * u_4;
  current_excess = if limit_current then noEvent(abs(u_2)) / i_limit - 1.0 else 0.0;
  voltage_excess = if limit_voltage then sqrt(u_3 * u_3 + u_4 * u_4) / u_limit - 1.0 else 0.0;
  saturated = noEvent(if current_excess > 0.0 or voltage_excess > 0.0 then 1.0 else 0.0);

  // adaptation (32), stopped where freeze_adaptation says so
  current_frozen = Functions.clamp(current_excess / limit.band, 0.0, 1.0);
  voltage_frozen = Functions.clamp(voltage_excess / limit.band, 0.0, 1.0);
  frozen[1] = noEvent(max(current_frozen, voltage_frozen));
  frozen[2] = frozen[1];
  frozen[3] = voltage_frozen;
  frozen[4] = voltage_frozen;
  for i in 1:4 loop
    growth[i] = -delta[i] * sigma[i] * theta[i] + 0.5 * zeta[i] * delta[i] * P[i] * P[i];
    der(theta[i]) = if freeze_adaptation
      then (1.0 - frozen[i]) * noEvent(min(growth[i], (limit.theta_max - theta[i]) / solver.internal_step))
      else growth[i];
  end for;
  annotation(
    Icon(graphics = {
      Text(extent = {{-80, 50}, {80, -10}}, textString = "RSBA", lineColor = {0, 0, 127}),
      Text(extent = {{-80, -20}, {80, -60}}, textString = "26 - 41", lineColor = {0, 0, 127})}),
    Documentation(info = "<html>
<p>Equations 26 to 41. There are four subsystems: 1 position, 2 speed, 3 q-axis current, 4 d-axis current; arrays are
indexed by them. The defaults are the laws as printed with the published gains of the lift; every departure is a switch
of its own:</p>
<ul>
<li><code>x_2d_in_a_1</code> (true as printed): (31) contains -x_2d, and P_2 = x_e2 - a_1 cancels the reference speed,
so a moving reference is followed with an error of 2 |v_d| / beta_1. Without it x_2d cancels the derivative of x_1d
instead (Omega_1 = 0 in (35)) and the lag goes.</li>
<li><code>feed_acceleration</code>: once P_2 counts the reference speed, (39) leaves its derivative to the robust gains;
adding a_d / A_2 to u_2 supplies it (Omega_2 = 0).</li>
<li><code>limit_acceleration</code>: the published start is millimetres from the reference and asks for 1e5 A. With limits
a linear a_1 overshoots; the speed it asks for is kept to what can be braked with a_max.</li>
<li><code>limit_current</code>, <code>limit_voltage</code>: keep i_q* and the voltage vector within what motor and inverter
can do.</li>
<li><code>freeze_adaptation</code>: (32) integrates errors that a saturated actuator cannot remove. Adaptation stops while
its subsystem saturates and at theta_max.</li>
<li><code>compensate</code>, <code>omega_u</code>: what acts unknown is estimated and taken off, d_hat by the observer,
the voltages here.</li>
<li><code>limit_speed</code>, <code>weaken_field</code>, <code>measure_supply</code>: speed and field that the supply's
voltage allows.</li>
</ul>
<p>|P_i|^2 in (32) is the plain square.</p>
</html>"));
end RsbaController;

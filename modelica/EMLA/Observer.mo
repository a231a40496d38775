within EMLA;
block Observer "Adaptive robust observer of screw position and speed"
  extends Interfaces.Block;

  record Known "The actuator as the observer knows it"
    Integer N_p(min = 1) = 8 "Number of pole pairs in the observer's model";
    Real Phi_PM(unit = "Wb") = 0.15 "Magnet flux in the observer's model";
    Real A_eq(unit = "kg.m", min = 1e-9) = 35.26 "Equivalent inertia in the observer's model";
    Real B_eq(unit = "kg.m/s", min = 0.0) = 3.67 "Equivalent friction in the observer's model";
  end Known;

  record Start "Where the estimate begins"
    Real x_hat(unit = "m") = 0.24 "Initial estimate of the position";
    Real eta_hat(min = 0.0) = 1.0 "Initial estimate of the bound";
  end Start;

  Interfaces.RealInput y(unit = "m", nominal = 0.1) "Measured screw position"
    annotation(Placement(transformation(extent = {{-120, 40}, {-100, 60}})));
  Interfaces.RealInput i_q_ref(unit = "A", nominal = 10.0) "Commanded q-axis current i_q*, used with use_model"
    annotation(Placement(transformation(extent = {{-120, -60}, {-100, -40}})));
  Interfaces.RealInput i_q(unit = "A", nominal = 10.0) "Measured q-axis current, used with use_measured_current"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));

  parameter Real alpha_1(unit = "1/s", min = 1e-9) = 0.3192 "Gain on the position estimate";
  parameter Real alpha_2(unit = "1/s2", min = 1e-9) = 0.3129 "Gain on the speed estimate";
  parameter Real Q_11(min = 1e-9) = 0.7752 "Q of the Lyapunov equation (18), row 1";
  parameter Real Q_12 = -0.0775 "Q of the Lyapunov equation (18), off the diagonal";
  parameter Real Q_22(min = 1e-9) = 0.3949 "Q of the Lyapunov equation (18), row 2";
  parameter Real H_0(min = 0.0) = 20.0 "H(y) = H_0 (cos(y)^4 + sin(y)^4), y in m (86)";
  parameter Real m_0(min = 1e-30) = 200.0 "m(t) = m_0 exp(-m_decay t) of (21) and (23) at t = 0";
  parameter Real m_decay(unit = "1/s", min = 1e-12) = 1e-3 "Decay of m(t), so that (22) holds";
  parameter Real ell(min = 0.0) = 1.0 "Adaptation gain of (23)";
  parameter Boolean use_model = true "Include B u + g of (20): commanded torque and viscous friction";
  parameter Boolean use_measured_current = false "Compute the torque of B u from the measured instead of the commanded current";
  parameter Real omega_d(unit = "1/s", min = 0.0) = 0.0 "Bandwidth of the estimated disturbance d_hat; 0 is none";
  parameter Real omega_r(unit = "1/s", min = 0.0) = 0.0 "Bandwidth of the estimated rate r_hat of d_hat; 0 is none";
  parameter Real ahead(unit = "s", min = 0.0) = 0.0 "Time by which d_hat predicts the disturbance";
  parameter Known known "The actuator as the observer knows it";
  parameter Start start "Start";

  Interfaces.RealOutput x_hat(start = start.x_hat, fixed = true, unit = "m", nominal = 0.1) "Estimated screw position"
    annotation(Placement(transformation(extent = {{100, 70}, {120, 90}})));
  Interfaces.RealOutput v_hat(start = 0.0, fixed = true, unit = "m/s", nominal = 0.1) "Estimated screw speed"
    annotation(Placement(transformation(extent = {{100, 30}, {120, 50}})));
  Interfaces.RealOutput d_hat(start = 0.0, fixed = true, unit = "m/s2") "Estimated disturbance of the screw's acceleration"
    annotation(Placement(transformation(extent = {{100, 10}, {120, 30}})));
  Interfaces.RealOutput eta_hat(start = start.eta_hat, fixed = true, min = 0.0) "Estimated bound of the uncertainty"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealOutput r_hat(start = 0.0, fixed = true, unit = "m/s3") "Estimated rate of the disturbance"
    annotation(Placement(transformation(extent = {{100, -30}, {120, -10}})));
  Interfaces.RealOutput y_bar(unit = "m") "Innovation y - x_hat"
    annotation(Placement(transformation(extent = {{100, -50}, {120, -30}})));
  Interfaces.RealOutput f "Robust term of (21)"
    annotation(Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  // solution p of (18) for A_bar = [-alpha_1, 1; -alpha_2, 0]
  final parameter Real p_12 = -0.5 * Q_22;
  final parameter Real p_11 = (Q_11 + alpha_2 * Q_22) / (2.0 * alpha_1);
  final parameter Real p_22 = (p_11 - alpha_1 * p_12 + Q_12) / alpha_2;
  final parameter Real determinant = p_11 * p_22 - p_12 * p_12;
  Real H "Bound of the uncertainty by (86)";
  Real m "Decaying term of (21) and (23), whose integral is bounded (22)";
  Real y_bar_abs(unit = "m") "||y_bar|| of (21) and (23)";
  Real bound "Bound of the robust term, eta_hat H (25)";
  Real current(unit = "A") "Current of B u";
  Real modelled(unit = "m/s2") "B u + g of (20)";
equation
  y_bar = y - x_hat;
  y_bar_abs = noEvent(abs(y_bar));
  H = H_0 * (cos(y) ^ 4 + sin(y) ^ 4);
  m = m_0 * exp(-m_decay * time);

  // (21)
  bound = eta_hat * H;
  f = bound * bound * y_bar / (bound * y_bar_abs + m);

  // (20) with A = [0, 1; 0, 0] and C = [1, 0]; p^-1 C' multiplies f
  current = if use_measured_current then i_q else i_q_ref;
  modelled = if use_model then (1.5 * known.N_p * known.Phi_PM * current - known.B_eq * v_hat) / known.A_eq else 0.0;
  der(x_hat) = v_hat + alpha_1 * y_bar + p_22 / determinant * f;
  der(v_hat) = modelled + d_hat - ahead * r_hat + alpha_2 * y_bar - p_12 / determinant * f;

  // what the model does not know
  der(r_hat) = omega_r * omega_d * alpha_2 * y_bar;
  der(d_hat) = omega_d * alpha_2 * y_bar + r_hat + ahead * omega_r * omega_d * alpha_2 * y_bar;

  // (23)
  der(eta_hat) = -m * ell * eta_hat + ell * H * y_bar_abs;
  annotation(
    Icon(graphics = {
      Text(extent = {{-80, 50}, {80, -10}}, textString = "observer", lineColor = {0, 0, 127}),
      Text(extent = {{-80, -20}, {80, -60}}, textString = "17 - 25", lineColor = {0, 0, 127})}),
    Documentation(info = "<html>
<p>Equations 17 to 25 with the functions of 101 to 103. Everything that acts on the screw's acceleration and is not
modelled counts as K in (17); f and eta_hat work against it. p is the solution of the Lyapunov equation (18) for the
given alpha and Q, where Algorithm 1 draws Q at random.</p>
<ul>
<li>Norms: the paper calls its norm the squared norm (after (19)). Here ||y_bar|| is the absolute value in (21) and (23):
only then is |f| &lt;= eta_hat H, as (25) and the stability proof need.</li>
<li><code>use_model</code>: B u + g is the commanded torque and the viscous friction of the estimated speed; C_eq and the
reluctance torque are left out, and the load is not in it.</li>
<li><code>omega_d</code>: an estimate d_hat of what the model does not know, load included, is added to (20); it
integrates the innovation. With <code>omega_r</code> it follows ramps, and predicts them by <code>ahead</code>.</li>
<li>The FMU's <code>interpolate</code> is not here: y and i_q are continuous.</li>
<li>The defaults are the published numbers of the lift.</li>
</ul>
</html>"));
end Observer;

within EMLA;
block Plant "PMSM-driven electromechanical linear actuator with inverter and sensors"
  extends Interfaces.Block;

  record Motor "Permanent magnet synchronous motor; d-q quantities are amplitude-invariant (peak)"
    Real R_s(unit = "Ohm", min = 0.0) = 0.14 "Stator resistance per phase";
    Real L_d(unit = "H", min = 1e-9) = 2.4e-3 "d-axis inductance";
    Real L_q(unit = "H", min = 1e-9) = 2.4e-3 "q-axis inductance";
    Real Phi_PM(unit = "Wb", min = 1e-9) = 0.15 "Permanent magnet flux linkage (peak)";
    Integer N_p(min = 1) = 8 "Number of pole pairs";
    Real J_m(unit = "kg.m2", min = 0.0) = 0.016 "Rotor inertia";
    Real B_m(unit = "N.m.s/rad", min = 0.0) = 1.67e-3 "Viscous friction of the rotor";
    Real i_max(unit = "A", min = 0.0) = 158.0 "Largest d- and q-axis current; controllers keep to less";
    Real i_N(unit = "A", min = 0.0) = 0.0 "Rated current (peak) that the winding bears for ever; 0 is no heating";
    Real permitted_rise(unit = "K", min = 1e-3) = 100.0 "Temperature rise of the winding that the rated current ends at";
    Real tau_th(unit = "s", min = 1e-3) = 100.0 "Thermal time constant of the winding";
  end Motor;

  record Coupling "Between motor and gearbox"
    Real J_c(unit = "kg.m2", min = 0.0) = 0.0 "Coupling inertia";
  end Coupling;

  record Gearbox "Between coupling and screw, with the efficiency of both"
    Real rho(min = 1e-9) = 1.0 / 7.0 "Screw turns per motor turn (gear ratio 1/rho)";
    Real J_GB(unit = "kg.m2", min = 0.0) = 0.0 "Gearbox inertia at the motor";
    Real eta_GB(min = 1e-3, max = 1.0) = 0.9 "Efficiency of gearbox and screw";
    Boolean directional = false "Whether losses of gearbox and screw go against the motion, whoever drives";
    Real eta_back(max = 1.0) = 0.0 "Efficiency where the load drives, used with directional; 0 is 2 - 1 / eta_GB";
  end Gearbox;

  record Screw "From rotary to linear motion"
    Real lead(unit = "m", min = 1e-9) = 0.02 "Screw travel per turn";
    Real M_BS(unit = "kg", min = 0.0) = 156.5 "Mass moved by the screw";
    Real B_BS(unit = "N.s/m", min = 0.0) = 0.0 "Viscous friction of the screw";
    Real C_eq(unit = "N", min = 0.0) = 0.0 "Torque per travel as printed; 0 is a rigid screw";
    Real q_LB(unit = "m") = 0.0 "Lower end of the stroke";
    Real q_UB(unit = "m") = 0.522 "Upper end of the stroke";
    Real v_max(unit = "m/s", min = 0.0) = 0.136 "Largest speed of the screw";
  end Screw;

  record Friction "Friction at the screw"
    Real F_C(unit = "N", min = 0.0) = 0.0 "Coulomb friction at the screw";
    Real F_S(unit = "N", min = 0.0) = 0.0 "Friction that breaks away at the screw";
    Real v_S(unit = "m/s", min = 1e-9) = 5e-3 "Speed at which friction is halfway between F_S and F_C";
    Real v_0(unit = "m/s", min = 1e-9) = 1e-4 "Speed within which friction is like a damper";
  end Friction;

  record EndStop "Stops at the ends of the stroke"
    Real stiffness(unit = "N/m2", min = 0.0) = 0.0 "Force of an end stop per squared depth; 0 is no end stop";
    Real damping(unit = "s/m", min = 0.0) = 0.0 "Relative growth of an end stop's force with the speed of approach";
  end EndStop;

  record Uncertainty "(84)"
    Real F_2 = 0.0 "Modelling error of g_2 as a fraction (84)";
    Real F_3 = 0.0 "Modelling error of g_3 as a fraction (84)";
    Real F_4 = 0.0 "Modelling error of g_4 as a fraction (84)";
  end Uncertainty;

  record Start "Where the motion begins"
    Real x_L(unit = "m") = 0.24 "Initial screw position";
  end Start;

  record Phase "Phase currents"
    Real i_a(unit = "A") "Current of phase a (magnet axis at x_L = 0)";
    Real i_b(unit = "A") "Current of phase b";
    Real i_c(unit = "A") "Current of phase c";
  end Phase;

  Interfaces.RealInput u_q(unit = "V", nominal = 100.0) "q-axis stator voltage demanded from the inverter"
    annotation(Placement(transformation(extent = {{-120, 80}, {-100, 100}})));
  Interfaces.RealInput u_d(unit = "V", nominal = 100.0) "d-axis stator voltage demanded from the inverter"
    annotation(Placement(transformation(extent = {{-120, 50}, {-100, 70}})));
  Interfaces.RealInput i_q_ref(unit = "A", nominal = 10.0) "Commanded q-axis current i_q*, used for torque_source = command"
    annotation(Placement(transformation(extent = {{-120, 20}, {-100, 40}})));
  Interfaces.RealInput F_L(unit = "N", nominal = 1e4) "Load force, positive against extension"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealInput d_2(unit = "m/s2") "Disturbance of the screw's acceleration"
    annotation(Placement(transformation(extent = {{-120, -40}, {-100, -20}})));
  Interfaces.RealInput d_3(unit = "V", nominal = 10.0) "Disturbance of the q-axis voltage"
    annotation(Placement(transformation(extent = {{-120, -70}, {-100, -50}})));
  Interfaces.RealInput d_4(unit = "V", nominal = 10.0) "Disturbance of the d-axis voltage"
    annotation(Placement(transformation(extent = {{-120, -100}, {-100, -80}})));
  Interfaces.RealInput sag "Part of the supply's voltage that is missing"
    annotation(Placement(transformation(extent = {{-70, -120}, {-50, -100}}, rotation = 90)));

  parameter Motor motor "Motor";
  parameter Coupling coupling "Coupling";
  parameter Gearbox gearbox "Gearbox";
  parameter Screw screw "Screw";
  parameter Friction friction "Friction";
  parameter EndStop stop "End stops";
  parameter Types.TorqueSource torque_source = Types.TorqueSource.current
    "Current that drives the screw: actual (physics) or commanded (paper)";
  parameter Uncertainty uncertainty "Uncertainty of the model";
  parameter Start start "Start";

  final parameter Real alpha_RL(unit = "rad/m") = Functions.alpha_RL(gearbox.rho, screw.lead) "Motor angle per travel";
  final parameter Real A_eq(unit = "kg.m") =
    Functions.A_eq(alpha_RL, motor.J_m + coupling.J_c + gearbox.J_GB, screw.M_BS) "Equivalent inertia";
  final parameter Real B_eq(unit = "kg.m/s") = Functions.B_eq(alpha_RL, motor.B_m, screw.B_BS) "Equivalent friction";
  final parameter Real D_eq(unit = "m") = Functions.D_eq(alpha_RL, gearbox.eta_GB) "Motor torque per load force";

  Inverter inverter "What makes the voltages"
    annotation(Placement(transformation(extent = {{-60, 50}, {-20, 90}})));
  Sensor sensor "Position and current sensors"
    annotation(Placement(transformation(extent = {{40, -50}, {80, -10}})));

  Interfaces.RealOutput x_L(start = start.x_L, fixed = true, unit = "m", nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{100, 80}, {120, 100}})));
  Interfaces.RealOutput v_L(start = 0.0, fixed = true, unit = "m/s", nominal = 0.1) "Screw speed"
    annotation(Placement(transformation(extent = {{100, 60}, {120, 80}})));
  Interfaces.RealOutput i_q(start = 0.0, fixed = true, unit = "A", nominal = 10.0) "q-axis stator current"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput i_d(start = 0.0, fixed = true, unit = "A", nominal = 10.0) "d-axis stator current"
    annotation(Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Interfaces.RealOutput temperature_rise(start = 0.0, fixed = true, unit = "K", nominal = 10.0) "Temperature rise of the winding"
    annotation(Placement(transformation(extent = {{60, 100}, {80, 120}}, rotation = 90)));
  Interfaces.RealOutput i_q_measured(unit = "A", nominal = 10.0) "q-axis current as the sensors give it"
    annotation(Placement(transformation(extent = {{-20, -120}, {0, -100}}, rotation = -90)));
  Interfaces.RealOutput i_d_measured(unit = "A", nominal = 10.0) "d-axis current as the sensors give it"
    annotation(Placement(transformation(extent = {{20, -120}, {40, -100}}, rotation = -90)));
  Interfaces.RealOutput motor_load "Copper loss relative to that of the rated current; 0 without one"
    annotation(Placement(transformation(extent = {{20, 100}, {40, 120}}, rotation = 90)));
  Interfaces.RealOutput x_measured(unit = "m", nominal = 0.1) "Position as the sensor gives it"
    annotation(Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Interfaces.RealOutput a_L(unit = "m/s2") "Screw acceleration"
    annotation(Placement(transformation(extent = {{100, 0}, {120, 20}})));
  Interfaces.RealOutput tau_m(unit = "N.m", nominal = 10.0) "Motor torque that drives the screw"
    annotation(Placement(transformation(extent = {{100, -20}, {120, 0}})));
  Interfaces.RealOutput omega_m(unit = "rad/s", nominal = 100.0) "Motor speed"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  Interfaces.RealOutput P_el(unit = "W", nominal = 1e3) "Electrical power into the motor"
    annotation(Placement(transformation(extent = {{100, -80}, {120, -60}})));
  Interfaces.RealOutput P_L(unit = "W", nominal = 1e3) "Mechanical power into the load"
    annotation(Placement(transformation(extent = {{100, -100}, {120, -80}})));
  Phase phase "Phase currents";
protected
  Real u_q_motor(unit = "V") "q-axis voltage at the motor";
  Real u_d_motor(unit = "V") "d-axis voltage at the motor";
  Real magnet_torque(unit = "N.m") "Part of tau_m that the permanent magnet makes with i_q or i_q*";
  Real reluctance_torque(unit = "N.m") "Part of tau_m that comes of L_d and L_q being different";
  Real omega_e(unit = "rad/s") "Electrical angular frequency";
  Real theta_e(unit = "rad") "Electrical angle";
  Real load_torque(unit = "N.m") "Motor torque that the load takes";
  Real contact(unit = "N") "Force of friction and end stops on the screw";
  Real g_2(unit = "m/s2") "Known part of the acceleration in (26), without the magnet's torque";
  Real g_3(unit = "A/s") "Known part of the derivative of i_q in (26), without the voltage";
  Real g_4(unit = "A/s") "Known part of the derivative of i_d in (26), without the voltage";
equation
  connect(u_q, inverter.demand_q)
    annotation(Line(points = {{-110, 90}, {-80, 90}, {-80, 80}, {-62, 80}}, color = {0, 0, 127}));
  connect(u_d, inverter.demand_d)
    annotation(Line(points = {{-110, 60}, {-62, 60}}, color = {0, 0, 127}));
  connect(sensor.x_measured, x_measured)
    annotation(Line(points = {{82, -30}, {110, -30}}, color = {0, 0, 127}));
  connect(sag, inverter.sag)
    annotation(Line(points = {{-60, -110}, {-60, -60}, {-80, -60}, {-80, 72}, {-62, 72}}, color = {0, 0, 127}));
  connect(sensor.i_q_measured, i_q_measured)
    annotation(Line(points = {{82, -40}, {90, -40}, {90, -80}, {-10, -80}, {-10, -110}}, color = {0, 0, 127}));
  connect(sensor.i_d_measured, i_d_measured)
    annotation(Line(points = {{82, -48}, {86, -48}, {86, -84}, {30, -84}, {30, -110}}, color = {0, 0, 127}));
  sensor.x = x_L;
  sensor.i_q = i_q;
  sensor.i_d = i_d;
  inverter.i_q = i_q;
  inverter.i_d = i_d;
  inverter.theta_e = theta_e;

  // disturbances come after the inverter's limit
  u_q_motor = inverter.u_q + d_3;
  u_d_motor = inverter.u_d + d_4;

  // torque (3)
  magnet_torque = 1.5 * motor.N_p * motor.Phi_PM * (if torque_source == Types.TorqueSource.command then i_q_ref else i_q);
  reluctance_torque = 1.5 * motor.N_p * i_q * i_d * (motor.L_d - motor.L_q);
  tau_m = magnet_torque + reluctance_torque;

  // (9) with the disturbances of (26) and the uncertainties of (84)
  omega_m = alpha_RL * v_L;
  omega_e = motor.N_p * omega_m;
  g_2 = (reluctance_torque - B_eq * v_L - screw.C_eq * x_L) / A_eq;
  g_3 = (-motor.R_s * i_q - omega_e * (i_d * motor.L_d + motor.Phi_PM)) / motor.L_q;
  g_4 = (-motor.R_s * i_d + omega_e * i_q * motor.L_q) / motor.L_d;
  load_torque = if gearbox.directional then
    Functions.felt_load(F_L, v_L, gearbox.eta_GB, gearbox.eta_back, friction.v_0) / alpha_RL else D_eq * F_L;
  contact = Functions.end_stop(max(screw.q_LB - x_L, 0.0), -v_L, stop.stiffness, stop.damping)
    - Functions.end_stop(max(x_L - screw.q_UB, 0.0), v_L, stop.stiffness, stop.damping)
    - Functions.friction(v_L, friction.F_C, friction.F_S, friction.v_S, friction.v_0);
  a_L = magnet_torque / A_eq + (1.0 + uncertainty.F_2) * g_2 + d_2 - load_torque / A_eq + contact / (alpha_RL * A_eq);
  der(x_L) = v_L;
  der(v_L) = a_L;
  der(i_q) = u_q_motor / motor.L_q + (1.0 + uncertainty.F_3) * g_3;
  der(i_d) = u_d_motor / motor.L_d + (1.0 + uncertainty.F_4) * g_4;

  // the winding as one body that ends at the permitted rise with the rated current
  motor_load = if motor.i_N > 0.0 then (i_q * i_q + i_d * i_d) / (motor.i_N * motor.i_N) else 0.0;
  der(temperature_rise) = (motor_load * motor.permitted_rise - temperature_rise) / motor.tau_th;

  P_el = 1.5 * (u_q_motor * i_q + u_d_motor * i_d);
  P_L = F_L * v_L;

  // what leaves its range says so
  assert(x_L >= screw.q_LB and x_L <= screw.q_UB, "x_L left its range", AssertionLevel.warning);
  assert(abs(v_L) <= screw.v_max, "v_L left its range", AssertionLevel.warning);
  assert(abs(i_q) <= motor.i_max, "i_q left its range", AssertionLevel.warning);
  assert(abs(i_d) <= motor.i_max, "i_d left its range", AssertionLevel.warning);
  assert(temperature_rise <= motor.permitted_rise, "temperature_rise left its range", AssertionLevel.warning);

  // (1) backwards, without zero sequence
  theta_e = motor.N_p * alpha_RL * x_L;
  phase.i_a = i_d * cos(theta_e) - i_q * sin(theta_e);
  phase.i_b = i_d * cos(theta_e - 2.0 * pi / 3.0) - i_q * sin(theta_e - 2.0 * pi / 3.0);
  phase.i_c = i_d * cos(theta_e + 2.0 * pi / 3.0) - i_q * sin(theta_e + 2.0 * pi / 3.0);
  annotation(
    Icon(graphics = {
      Rectangle(extent = {{-70, 35}, {-5, -35}}, lineColor = {60, 60, 60}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-5, 10}, {70, -10}}, lineColor = {60, 60, 60}, fillColor = {225, 225, 225}, fillPattern = FillPattern.Solid),
      Text(extent = {{-70, -50}, {70, -80}}, textString = "EMLA", lineColor = {60, 60, 60})}),
    Documentation(info = "<html>
<p>Motor in d-q coordinates (3), gearbox and screw (4) to (6), together (9); disturbances as in (26), uncertainties as
in (84). The states are x_1 = x_L, x_2 = v_L, x_3 = i_q and x_4 = i_d; x_L grows as the actuator extends.</p>
<ul>
<li><code>torque_source</code>: (9) drives the screw with the commanded current i_q*, (3) with the actual i_q. The
default is the actual current; <code>command</code> is the paper's idealisation.</li>
<li><code>screw.C_eq</code>: as printed, a spring from the load to ground. Its default 0 is a rigid screw.</li>
<li>A_eq multiplies an acceleration into a torque, so its unit is kg.m, not kg as printed.</li>
<li>What a drive has beside the paper's plant is off by default: dead time, current sensors, friction, an efficiency that
depends on the direction of power, end stops, and the temperature of the winding.</li>
<li>Not in the paper: the values of J_c, J_GB, B_m, B_BS and eta_GB (the defaults are assumptions), and the sensor's noise
and resolution. d_1 and F_1 of (26) are 0.</li>
</ul>
</html>"));
end Plant;

within EMLA;
partial block Electrics "Motor currents, torque, inverter and sensors, at a screw that moves"
  extends Interfaces.Block;

  record MotorData "Permanent magnet synchronous motor; d-q quantities are amplitude-invariant (peak)"
    Real R_s(unit = "Ohm", min = 0.0) = 0.14 "Stator resistance per phase";
    Real L_d(unit = "H", min = 1e-9) = 2.4e-3 "d-axis inductance";
    Real L_q(unit = "H", min = 1e-9) = 2.4e-3 "q-axis inductance";
    Real Phi_PM(unit = "Wb", min = 1e-9) = 0.15 "Permanent magnet flux linkage (peak)";
    Integer N_p(min = 1) = 8 "Number of pole pairs";
    Real i_max(unit = "A", min = 0.0) = 158.0 "Largest d- and q-axis current; controllers keep to less";
    Real i_N(unit = "A", min = 0.0) = 0.0 "Rated continuous current (peak) of the winding; 0 is no heating";
    Real permitted_rise(unit = "K", min = 1e-3) = 100.0 "Steady temperature rise of the winding at the rated current";
    Real tau_th(unit = "s", min = 1e-3) = 100.0 "Thermal time constant of the winding";
  end MotorData;

  record GearboxData "Between coupling and screw, with the efficiency of both"
    Real rho(min = 1e-9) = 1.0 / 7.0 "Screw turns per motor turn (gear ratio 1/rho)";
  end GearboxData;

  record ScrewData "From rotary to linear motion"
    Real lead(unit = "m", min = 1e-9) = 0.02 "Screw travel per turn";
  end ScrewData;

  record UncertaintyData "(84)"
    Real F_3 = 0.0 "Modelling error of g_3 as a fraction (84)";
    Real F_4 = 0.0 "Modelling error of g_4 as a fraction (84)";
  end UncertaintyData;

  record Phase "Phase currents"
    Real i_a(unit = "A") "Current of phase a (magnet axis at x_L = 0)";
    Real i_b(unit = "A") "Current of phase b";
    Real i_c(unit = "A") "Current of phase c";
  end Phase;

  Interfaces.RealInput u_q(unit = "V", nominal = 100.0) "q-axis stator voltage demanded from the inverter"
    annotation(Placement(transformation(extent = {{-120, 80}, {-100, 100}})));
  Interfaces.RealInput u_d(unit = "V", nominal = 100.0) "d-axis stator voltage demanded from the inverter"
    annotation(Placement(transformation(extent = {{-120, 50}, {-100, 70}})));
  Interfaces.RealInput i_q_ref(unit = "A", nominal = 10.0) "Commanded q-axis current i_q*, used with use_commanded_current"
    annotation(Placement(transformation(extent = {{-120, 20}, {-100, 40}})));
  Interfaces.RealInput d_3(unit = "V", nominal = 10.0) "Disturbance of the q-axis voltage"
    annotation(Placement(transformation(extent = {{-120, -70}, {-100, -50}})));
  Interfaces.RealInput d_4(unit = "V", nominal = 10.0) "Disturbance of the d-axis voltage"
    annotation(Placement(transformation(extent = {{-120, -100}, {-100, -80}})));
  Interfaces.RealInput sag "Missing fraction of the supply voltage"
    annotation(Placement(transformation(extent = {{-70, -120}, {-50, -100}}, rotation = 90)));

  parameter Boolean use_commanded_current = false
    "Compute the torque from the commanded (paper) instead of the actual current";

  Inverter inverter "What makes the voltages"
    annotation(Placement(transformation(extent = {{-60, 50}, {-20, 90}})));
  Sensor sensor "Position and current sensors"
    annotation(Placement(transformation(extent = {{40, -50}, {80, -10}})));

  Interfaces.RealOutput i_q(start = 0.0, fixed = true, unit = "A", nominal = 10.0) "q-axis stator current"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput i_d(start = 0.0, fixed = true, unit = "A", nominal = 10.0) "d-axis stator current"
    annotation(Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Interfaces.RealOutput temperature_rise(start = 0.0, fixed = true, unit = "K", nominal = 10.0) "Temperature rise of the winding"
    annotation(Placement(transformation(extent = {{60, 100}, {80, 120}}, rotation = 90)));
  Interfaces.RealOutput i_q_measured(unit = "A", nominal = 10.0) "Measured q-axis current"
    annotation(Placement(transformation(extent = {{-20, -120}, {0, -100}}, rotation = -90)));
  Interfaces.RealOutput i_d_measured(unit = "A", nominal = 10.0) "Measured d-axis current"
    annotation(Placement(transformation(extent = {{20, -120}, {40, -100}}, rotation = -90)));
  Interfaces.RealOutput motor_load "Copper loss relative to that of the rated current; 0 without one"
    annotation(Placement(transformation(extent = {{20, 100}, {40, 120}}, rotation = 90)));
  Interfaces.RealOutput x_measured(unit = "m", nominal = 0.1) "Measured position"
    annotation(Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Interfaces.RealOutput tau_m(unit = "N.m", nominal = 10.0) "Motor torque that drives the screw"
    annotation(Placement(transformation(extent = {{100, -20}, {120, 0}})));
  Interfaces.RealOutput omega_m(unit = "rad/s", nominal = 100.0) "Motor speed"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  Interfaces.RealOutput P_el(unit = "W", nominal = 1e3) "Electrical power into the motor"
    annotation(Placement(transformation(extent = {{100, -80}, {120, -60}})));
  Phase phase "Phase currents";
protected
  parameter Real R_s(unit = "Ohm") "motor.R_s";
  parameter Real L_d(unit = "H") "motor.L_d";
  parameter Real L_q(unit = "H") "motor.L_q";
  parameter Real Phi_PM(unit = "Wb") "motor.Phi_PM";
  parameter Integer N_p "motor.N_p";
  parameter Real i_max(unit = "A") "motor.i_max";
  parameter Real i_N(unit = "A") "motor.i_N";
  parameter Real permitted_rise(unit = "K") "motor.permitted_rise";
  parameter Real tau_th(unit = "s") "motor.tau_th";
  parameter Real F_3 "uncertainty.F_3";
  parameter Real F_4 "uncertainty.F_4";
  parameter Real turns(unit = "rad/m") "alpha_RL";
  Real position(unit = "m") "Where the screw is";
  Real speed(unit = "m/s") "How fast it moves";
  Real u_q_motor(unit = "V") "q-axis voltage at the motor";
  Real u_d_motor(unit = "V") "d-axis voltage at the motor";
  Real magnet_torque(unit = "N.m") "Part of tau_m that the permanent magnet makes with i_q or i_q*";
  Real reluctance_torque(unit = "N.m") "Part of tau_m that comes of L_d and L_q being different";
  Real omega_e(unit = "rad/s") "Electrical angular frequency";
  Real theta_e(unit = "rad") "Electrical angle";
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
  sensor.x = position;
  sensor.i_q = i_q;
  sensor.i_d = i_d;
  inverter.i_q = i_q;
  inverter.i_d = i_d;
  inverter.theta_e = theta_e;

  // disturbances come after the inverter's limit
  u_q_motor = inverter.u_q + d_3;
  u_d_motor = inverter.u_d + d_4;

  // torque (3)
  magnet_torque = 1.5 * N_p * Phi_PM * (if use_commanded_current then i_q_ref else i_q);
  reluctance_torque = 1.5 * N_p * i_q * i_d * (L_d - L_q);
  tau_m = magnet_torque + reluctance_torque;

  // the currents of (9) with the disturbances of (26) and the uncertainties of (84)
  omega_m = turns * speed;
  omega_e = N_p * omega_m;
  g_3 = (-R_s * i_q - omega_e * (i_d * L_d + Phi_PM)) / L_q;
  g_4 = (-R_s * i_d + omega_e * i_q * L_q) / L_d;
  der(i_q) = u_q_motor / L_q + (1.0 + F_3) * g_3;
  der(i_d) = u_d_motor / L_d + (1.0 + F_4) * g_4;

  // the winding as one body that ends at the permitted rise with the rated current
  motor_load = if i_N > 0.0 then (i_q * i_q + i_d * i_d) / (i_N * i_N) else 0.0;
  der(temperature_rise) = (motor_load * permitted_rise - temperature_rise) / tau_th;

  P_el = 1.5 * (u_q_motor * i_q + u_d_motor * i_d);

  // what leaves its range says so
  assert(abs(i_q) <= i_max, "i_q left its range", AssertionLevel.warning);
  assert(abs(i_d) <= i_max, "i_d left its range", AssertionLevel.warning);
  assert(temperature_rise <= permitted_rise, "temperature_rise left its range", AssertionLevel.warning);

  // (1) backwards, without zero sequence
  theta_e = N_p * turns * position;
  phase.i_a = i_d * cos(theta_e) - i_q * sin(theta_e);
  phase.i_b = i_d * cos(theta_e - 2.0 * pi / 3.0) - i_q * sin(theta_e - 2.0 * pi / 3.0);
  phase.i_c = i_d * cos(theta_e + 2.0 * pi / 3.0) - i_q * sin(theta_e + 2.0 * pi / 3.0);
  annotation(Documentation(info = "<html>
<p>What <a href=\"modelica://EMLA.Plant\">Plant</a> and <a href=\"modelica://EMLA.Motor\">Motor</a> have in common. Who
extends it says where the screw is and how fast it moves.</p>
</html>"));
end Electrics;

within EMLA;
block Plant "PMSM-driven electromechanical linear actuator with inverter and sensors"
  extends Electrics(
    R_s = motor.R_s,
    L_d = motor.L_d,
    L_q = motor.L_q,
    Phi_PM = motor.Phi_PM,
    N_p = motor.N_p,
    i_max = motor.i_max,
    i_N = motor.i_N,
    permitted_rise = motor.permitted_rise,
    tau_th = motor.tau_th,
    F_3 = uncertainty.F_3,
    F_4 = uncertainty.F_4,
    turns = alpha_RL);

  record Motor "Motor with its rotor"
    extends MotorData;
    Real J_m(unit = "kg.m2", min = 0.0) = 0.016 "Rotor inertia";
    Real B_m(unit = "N.m.s/rad", min = 0.0) = 1.67e-3 "Viscous friction of the rotor";
  end Motor;

  record Coupling "Between motor and gearbox"
    Real J_c(unit = "kg.m2", min = 0.0) = 0.0 "Coupling inertia";
  end Coupling;

  record Gearbox "Between coupling and screw, with the efficiency of both"
    extends GearboxData;
    Real J_GB(unit = "kg.m2", min = 0.0) = 0.0 "Gearbox inertia at the motor";
    Real eta_GB(min = 1e-3, max = 1.0) = 0.9 "Efficiency of gearbox and screw";
    Boolean directional = false "Whether losses of gearbox and screw always oppose the motion";
    Real eta_back(max = 1.0) = 0.0 "Efficiency where the load drives, used with directional; 0 is 2 - 1 / eta_GB";
  end Gearbox;

  record Screw "From rotary to linear motion"
    extends ScrewData;
    Real M_BS(unit = "kg", min = 0.0) = 156.5 "Mass moved by the screw";
    Real B_BS(unit = "N.s/m", min = 0.0) = 0.0 "Viscous friction of the screw";
    Real C_eq(unit = "N", min = 0.0) = 0.0 "Torque per travel as printed; 0 is a rigid screw";
    Real q_LB(unit = "m") = 0.0 "Lower end of the stroke";
    Real q_UB(unit = "m") = 0.522 "Upper end of the stroke";
    Real v_max(unit = "m/s", min = 0.0) = 0.136 "Largest speed of the screw";
  end Screw;

  record Friction "Friction at the screw"
    Real F_C(unit = "N", min = 0.0) = 0.0 "Coulomb friction at the screw";
    Real F_S(unit = "N", min = 0.0) = 0.0 "Breakaway friction at the screw";
    Real v_S(unit = "m/s", min = 1e-9) = 5e-3 "Speed at which friction is halfway between F_S and F_C";
    Real v_0(unit = "m/s", min = 1e-9) = 1e-4 "Speed below which friction acts like a damper";
  end Friction;

  record EndStop "Stops at the ends of the stroke"
    Real stiffness(unit = "N/m2", min = 0.0) = 0.0 "Force of an end stop per squared depth; 0 is no end stop";
    Real damping(unit = "s/m", min = 0.0) = 0.0 "Relative growth of an end stop's force with the speed of approach";
  end EndStop;

  record Uncertainty "(84)"
    extends UncertaintyData;
    Real F_2 = 0.0 "Modelling error of g_2 as a fraction (84)";
  end Uncertainty;

  record Start "Where the motion begins"
    Real x_L(unit = "m") = 0.24 "Initial screw position";
  end Start;

  Interfaces.RealInput F_L(unit = "N", nominal = 1e4) "Load force, positive against extension"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealInput d_2(unit = "m/s2") "Disturbance of the screw's acceleration"
    annotation(Placement(transformation(extent = {{-120, -40}, {-100, -20}})));

  parameter Motor motor "Motor";
  parameter Coupling coupling "Coupling";
  parameter Gearbox gearbox "Gearbox";
  parameter Screw screw "Screw";
  parameter Friction friction "Friction";
  parameter EndStop stop "End stops";
  parameter Uncertainty uncertainty "Uncertainty of the model";
  parameter Start start "Start";

  final parameter Real alpha_RL(unit = "rad/m") = Functions.alpha_RL(gearbox.rho, screw.lead) "Motor angle per travel";
  final parameter Real A_eq(unit = "kg.m") =
    Functions.A_eq(alpha_RL, motor.J_m + coupling.J_c + gearbox.J_GB, screw.M_BS) "Equivalent inertia";
  final parameter Real B_eq(unit = "kg.m/s") = Functions.B_eq(alpha_RL, motor.B_m, screw.B_BS) "Equivalent friction";
  final parameter Real D_eq(unit = "m") = Functions.D_eq(alpha_RL, gearbox.eta_GB) "Motor torque per load force";

  Interfaces.RealOutput x_L(start = start.x_L, fixed = true, unit = "m", nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{100, 80}, {120, 100}})));
  Interfaces.RealOutput v_L(start = 0.0, fixed = true, unit = "m/s", nominal = 0.1) "Screw speed"
    annotation(Placement(transformation(extent = {{100, 60}, {120, 80}})));
  Interfaces.RealOutput a_L(unit = "m/s2") "Screw acceleration"
    annotation(Placement(transformation(extent = {{100, 0}, {120, 20}})));
  Interfaces.RealOutput P_L(unit = "W", nominal = 1e3) "Mechanical power into the load"
    annotation(Placement(transformation(extent = {{100, -100}, {120, -80}})));
protected
  Real load_torque(unit = "N.m") "Motor torque that the load takes";
  Real contact(unit = "N") "Force of friction and end stops on the screw";
  Real g_2(unit = "m/s2") "Known part of the acceleration in (26), without the magnet's torque";
equation
  position = x_L;
  speed = v_L;

  // (9) with the disturbances of (26) and the uncertainties of (84)
  g_2 = (reluctance_torque - B_eq * v_L - screw.C_eq * x_L) / A_eq;
  load_torque = if gearbox.directional then
    Functions.felt_load(F_L, v_L, gearbox.eta_GB, gearbox.eta_back, friction.v_0) / alpha_RL else D_eq * F_L;
  contact = Functions.end_stop(max(screw.q_LB - x_L, 0.0), -v_L, stop.stiffness, stop.damping)
    - Functions.end_stop(max(x_L - screw.q_UB, 0.0), v_L, stop.stiffness, stop.damping)
    - Functions.friction(v_L, friction.F_C, friction.F_S, friction.v_S, friction.v_0);
  a_L = magnet_torque / A_eq + (1.0 + uncertainty.F_2) * g_2 + d_2 - load_torque / A_eq + contact / (alpha_RL * A_eq);
  der(x_L) = v_L;
  der(v_L) = a_L;

  P_L = F_L * v_L;

  // what leaves its range says so
  assert(x_L >= screw.q_LB and x_L <= screw.q_UB, "x_L left its range", AssertionLevel.warning);
  assert(abs(v_L) <= screw.v_max, "v_L left its range", AssertionLevel.warning);
  annotation(
    Icon(graphics = {
      Rectangle(extent = {{-70, 35}, {-5, -35}}, lineColor = {60, 60, 60}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-5, 10}, {70, -10}}, lineColor = {60, 60, 60}, fillColor = {225, 225, 225}, fillPattern = FillPattern.Solid),
      Text(extent = {{-70, -50}, {70, -80}}, textString = "EMLA", lineColor = {60, 60, 60})}),
    Documentation(info = "<html>
<p>Motor in d-q coordinates (3), gearbox and screw (4) to (6), together (9); disturbances as in (26), uncertainties as
in (84). The states are x_1 = x_L, x_2 = v_L, x_3 = i_q and x_4 = i_d; x_L grows as the actuator extends.</p>
<ul>
<li><code>use_commanded_current</code>: (9) drives the screw with the commanded current i_q*, (3) with the actual i_q. The
default is the actual current; the commanded one is the paper's idealisation.</li>
<li><code>screw.C_eq</code>: as printed, a spring from the load to ground. Its default 0 is a rigid screw.</li>
<li>A_eq multiplies an acceleration into a torque, so its unit is kg.m, not kg as printed.</li>
<li>What a drive has beside the paper's plant is off by default: dead time, current sensors, friction, an efficiency that
depends on the direction of power, end stops, and the temperature of the winding.</li>
<li>Not in the paper: the values of J_c, J_GB, B_m, B_BS and eta_GB (the defaults are assumptions), and the sensor's noise
and resolution. d_1 and F_1 of (26) are 0.</li>
</ul>
</html>"));
end Plant;

within EMLA;
block Motor "Electrical half of the actuator: position and speed of the screw in, motor torque out"
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

  parameter MotorData motor "Motor";
  parameter GearboxData gearbox "Gearbox";
  parameter ScrewData screw "Screw";
  parameter UncertaintyData uncertainty "Uncertainty of the model";

  final parameter Real alpha_RL(unit = "rad/m") = Functions.alpha_RL(gearbox.rho, screw.lead) "Motor angle per travel";

  Interfaces.RealInput x_L(unit = "m", nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealInput v_L(unit = "m/s", nominal = 0.1) "Screw speed"
    annotation(Placement(transformation(extent = {{-120, -40}, {-100, -20}})));
equation
  position = x_L;
  speed = v_L;
  annotation(
    Icon(graphics = {
      Rectangle(extent = {{-70, 35}, {-5, -35}}, lineColor = {60, 60, 60}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-5, 10}, {30, -10}}, lineColor = {60, 60, 60}, fillColor = {225, 225, 225}, fillPattern = FillPattern.Solid),
      Text(extent = {{-70, -50}, {70, -80}}, textString = "motor", lineColor = {60, 60, 60})}),
    Documentation(info = "<html>
<p>For a machine that computes the motion of its screws itself. Everything electrical is that of
<a href=\"modelica://EMLA.Plant\">Plant</a>.</p>
</html>"));
end Motor;

within EMLA;
block Inverter "Mean voltages of an inverter: within its limit, less what dead time takes"
  extends Interfaces.Block;
  parameter Real u_max(unit = "V", min = 1e-3) = 445.0 "Longest voltage vector of the inverter";
  parameter Real dead_time(unit = "s", min = 0.0) = 0.0 "Uncompensated dead time of the inverter's legs";
  parameter Real f_PWM(unit = "Hz", min = 0.0) = 8e3 "Switching frequency";
  parameter Real i_0(unit = "A", min = 1e-9) = 0.5 "Phase current below which dead time takes less voltage";
  Interfaces.RealInput demand_q(unit = "V", nominal = 100.0) "q-axis voltage demanded"
    annotation(Placement(transformation(extent = {{-120, 80}, {-100, 100}})));
  Interfaces.RealInput demand_d(unit = "V", nominal = 100.0) "d-axis voltage demanded"
    annotation(Placement(transformation(extent = {{-120, 40}, {-100, 60}})));
  Interfaces.RealInput sag "Missing fraction of the supply voltage"
    annotation(Placement(transformation(extent = {{-120, 0}, {-100, 20}})));
  Interfaces.RealInput i_q(unit = "A", nominal = 10.0) "q-axis stator current"
    annotation(Placement(transformation(extent = {{-120, -30}, {-100, -10}})));
  Interfaces.RealInput i_d(unit = "A", nominal = 10.0) "d-axis stator current"
    annotation(Placement(transformation(extent = {{-120, -60}, {-100, -40}})));
  Interfaces.RealInput theta_e(unit = "rad") "Electrical angle"
    annotation(Placement(transformation(extent = {{-120, -90}, {-100, -70}})));
  Interfaces.RealOutput u_q(unit = "V", nominal = 100.0) "q-axis voltage after the inverter"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput u_d(unit = "V", nominal = 100.0) "d-axis voltage after the inverter"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealOutput saturated "1 while the demanded voltage exceeds the limit"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  Interfaces.RealOutput u_available(unit = "V", nominal = 100.0) "Longest voltage vector that the supply allows, as measured by the drive"
    annotation(Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  Real scale "Factor on the demanded vector";
  Real lost(unit = "V") "Mean voltage that a leg loses at a large current";
  Real e_a(unit = "V") "Mean voltage that dead time adds to phase a";
  Real e_b(unit = "V") "Mean voltage that dead time adds to phase b";
  Real e_c(unit = "V") "Mean voltage that dead time adds to phase c";
equation
  u_available = u_max * (1.0 - sag);
  scale = Functions.shortening(demand_q, demand_d, u_available);
  lost = dead_time * f_PWM * sqrt(3.0) * u_available;
  e_a = -lost * Functions.smooth_sign(i_d * cos(theta_e) - i_q * sin(theta_e), i_0);
  e_b = -lost * Functions.smooth_sign(i_d * cos(theta_e - 2.0 * pi / 3.0) - i_q * sin(theta_e - 2.0 * pi / 3.0), i_0);
  e_c = -lost * Functions.smooth_sign(i_d * cos(theta_e + 2.0 * pi / 3.0) - i_q * sin(theta_e + 2.0 * pi / 3.0), i_0);
  u_q = scale * demand_q - 2.0 / 3.0 * (e_a * sin(theta_e) + e_b * sin(theta_e - 2.0 * pi / 3.0) + e_c * sin(theta_e + 2.0 * pi / 3.0));
  u_d = scale * demand_d + 2.0 / 3.0 * (e_a * cos(theta_e) + e_b * cos(theta_e - 2.0 * pi / 3.0) + e_c * cos(theta_e + 2.0 * pi / 3.0));
  saturated = noEvent(if scale < 1.0 - 1e-9 then 1.0 else 0.0);
  annotation(
    Icon(graphics = {Line(points = {{-70, -60}, {-30, -60}, {30, 60}, {70, 60}}, color = {0, 0, 127}, thickness = 0.5)}),
    Documentation(info = "<html>
<p>A voltage vector that is too long is shortened in its own direction. A leg loses the dead time's part of U_dc in each
period, against its current; a linear modulation reaches u_max = U_dc / sqrt(3).</p>
</html>"));
end Inverter;

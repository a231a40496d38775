within EMLA;
block Inverter "Shortens a voltage vector that is too long, in its own direction"
  extends Interfaces.Block;
  parameter Real u_max(unit = "V", min = 1e-3) = 445.0 "Longest voltage vector of the inverter";
  Interfaces.RealInput demand_q(unit = "V", nominal = 100.0) "q-axis voltage demanded"
    annotation(Placement(transformation(extent = {{-120, 40}, {-100, 60}})));
  Interfaces.RealInput demand_d(unit = "V", nominal = 100.0) "d-axis voltage demanded"
    annotation(Placement(transformation(extent = {{-120, -60}, {-100, -40}})));
  Interfaces.RealOutput u_q(unit = "V", nominal = 100.0) "q-axis voltage after the inverter's limit"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput u_d(unit = "V", nominal = 100.0) "d-axis voltage after the inverter's limit"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealOutput saturated "1 while the demanded voltage exceeds the limit"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
protected
  Real scale "Factor on the demanded vector";
equation
  scale = Functions.shortening(demand_q, demand_d, u_max);
  u_q = scale * demand_q;
  u_d = scale * demand_d;
  saturated = noEvent(if scale < 1.0 - 1e-9 then 1.0 else 0.0);
  annotation(
    Icon(graphics = {Line(points = {{-70, -60}, {-30, -60}, {30, 60}, {70, 60}}, color = {0, 0, 127}, thickness = 0.5)}));
end Inverter;

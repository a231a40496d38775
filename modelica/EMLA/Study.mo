within EMLA;
model Study "Three joints: repaired RSBA and observer, true torque, limits, all disturbances"
  Lift lift "Lift joint"
    annotation(Placement(transformation(extent = {{-90, -20}, {-50, 20}})));
  Tilt tilt "Tilt joint"
    annotation(Placement(transformation(extent = {{-20, -20}, {20, 20}})));
  Telescope telescope "Telescope joint"
    annotation(Placement(transformation(extent = {{50, -20}, {90, 20}})));
  annotation(
    experiment(StartTime = 0.0, StopTime = 10.0, Tolerance = 1e-6, Interval = 1e-3),
    Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Ellipse(extent = {{-100, 100}, {100, -100}}, lineColor = {75, 138, 73}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Polygon(points = {{-36, 60}, {64, 0}, {-36, -60}}, lineColor = {75, 138, 73}, fillColor = {75, 138, 73}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>The scenario <code>study</code> of EMLA-Cosim: initial conditions of Table V, disturbances (82) read in
m/s2 and (83), uncertainties (84), quintic references and constant loads. The joints do not act on each other.</p>
</html>"));
end Study;

within EMLA;
block Sensor "Position sensor with noise and rounding, and current sensors"
  extends Interfaces.Block;
  parameter Real sigma(unit = "m", min = 0.0) = 0.0 "Standard deviation of the position noise";
  parameter Real resolution(unit = "m", min = 0.0) = 0.0 "Position step of the sensor; 0 is none";
  parameter Integer seed(min = 1, max = 2147483646) = 20240901 "Start of the noise sequence";
  parameter Real period(unit = "s", min = 1e-9) = 1e-4 "Time between two samples: the communication step of the FMU";
  CurrentSensor current(period = period) "Current sensors"
    annotation(Placement(transformation(extent = {{-20, -90}, {20, -50}})));
  Interfaces.RealInput x(unit = "m", nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealOutput x_measured(unit = "m", nominal = 0.1) "Measured position"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealInput i_q(unit = "A", nominal = 10.0) "q-axis stator current"
    annotation(Placement(transformation(extent = {{-120, -60}, {-100, -40}})));
  Interfaces.RealInput i_d(unit = "A", nominal = 10.0) "d-axis stator current"
    annotation(Placement(transformation(extent = {{-120, -100}, {-100, -80}})));
  Interfaces.RealOutput i_q_measured(unit = "A", nominal = 10.0) "Measured q-axis current"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  Interfaces.RealOutput i_d_measured(unit = "A", nominal = 10.0) "Measured d-axis current"
    annotation(Placement(transformation(extent = {{100, -100}, {120, -80}})));
  discrete Real random(start = seed, fixed = true) "State of the noise generator";
  discrete Real noise(start = 0.0, fixed = true) "Present draw from N(0, 1)";
protected
  final parameter Real interval(unit = "s") =
    if sigma > 0.0 or resolution > 0.0 then period else NEVER "An ideal sensor needs no events";
  discrete Real error(unit = "m") "Noise and rounding of the last sample";
equation
  when sample(interval, interval) then
    random = Functions.lehmer(Functions.lehmer(pre(random)));
    noise = Functions.normal(Functions.lehmer(pre(random)), random);
  end when;
  when {initial(), sample(interval, interval)} then
    error = Functions.quantized(x + sigma * noise, resolution) - x;
  end when;
  x_measured = x + error;
  connect(i_q, current.i_q)
    annotation(Line(points = {{-110, -50}, {-66, -50}, {-66, -60}, {-22, -60}}, color = {0, 0, 127}));
  connect(i_d, current.i_d)
    annotation(Line(points = {{-110, -90}, {-66, -90}, {-66, -80}, {-22, -80}}, color = {0, 0, 127}));
  connect(current.i_q_measured, i_q_measured)
    annotation(Line(points = {{22, -60}, {66, -60}, {66, -50}, {110, -50}}, color = {0, 0, 127}));
  connect(current.i_d_measured, i_d_measured)
    annotation(Line(points = {{22, -80}, {66, -80}, {66, -90}, {110, -90}}, color = {0, 0, 127}));
  annotation(
    Icon(graphics = {Line(points = {{-70, -60}, {-35, -60}, {-35, -20}, {0, -20}, {0, 20}, {35, 20}, {35, 60}, {70, 60}}, color = {0, 0, 127}, thickness = 0.5)}),
    Documentation(info = "<html>
<p>Noise and rounding are sampled every <code>period</code> and held; the position itself goes through. At the samples
x_measured is what the FMU gives when it is stepped by <code>period</code>, with the same noise. Between them it moves on:
the FMU's observer is read at the samples only, but a continuous controller would see each step of a staircase in v_hat.</p>
<p>Without noise and rounding nothing is sampled and no noise is drawn.</p>
</html>"));
end Sensor;

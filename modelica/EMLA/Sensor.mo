within EMLA;
block Sensor "Position sensor with noise and rounding"
  extends Interfaces.Block;
  parameter Real sigma(unit = "m", min = 0.0) = 0.0 "Standard deviation of the position noise";
  parameter Real resolution(unit = "m", min = 0.0) = 0.0 "Position step of the sensor; 0 is none";
  parameter Integer seed(min = 1, max = 2147483646) = 20240901 "Start of the noise sequence";
  parameter Real period(unit = "s", min = 1e-9) = 1e-4 "Time between two samples: the communication step of the FMU";
  Interfaces.RealInput x(unit = "m", nominal = 0.1) "Screw position"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  Interfaces.RealOutput x_measured(unit = "m", nominal = 0.1) "Position as the sensor gives it"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
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
  annotation(
    Icon(graphics = {Line(points = {{-70, -60}, {-35, -60}, {-35, -20}, {0, -20}, {0, 20}, {35, 20}, {35, 60}, {70, 60}}, color = {0, 0, 127}, thickness = 0.5)}),
    Documentation(info = "<html>
<p>Noise and rounding are sampled every <code>period</code> and held; the position itself goes through. At the samples
x_measured is what the FMU gives when it is stepped by <code>period</code>, with the same noise. Between them it moves on:
the FMU's observer is read at the samples only, but a continuous controller would see each step of a staircase in v_hat.</p>
<p>Without noise and rounding nothing is sampled and no noise is drawn.</p>
</html>"));
end Sensor;

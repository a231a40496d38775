within EMLA;
block CurrentSensor "Current sensors with noise and rounding, in d-q"
  extends Interfaces.Block;
  parameter Real sigma(unit = "A", min = 0.0) = 0.0 "Standard deviation of the noise of i_q and i_d";
  parameter Real resolution(unit = "A", min = 0.0) = 0.0 "Current step of the sensors; 0 is none";
  parameter Integer seed(min = 1, max = 2147483646) = 1043618065 "Start of the currents' noise sequence";
  parameter Real period(unit = "s", min = 1e-9) = 1e-4 "Time between two samples: the communication step of the FMU";
  Interfaces.RealInput i_q(unit = "A", nominal = 10.0) "q-axis stator current"
    annotation(Placement(transformation(extent = {{-120, 40}, {-100, 60}})));
  Interfaces.RealInput i_d(unit = "A", nominal = 10.0) "d-axis stator current"
    annotation(Placement(transformation(extent = {{-120, -60}, {-100, -40}})));
  Interfaces.RealOutput i_q_measured(unit = "A", nominal = 10.0) "Measured q-axis current"
    annotation(Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Interfaces.RealOutput i_d_measured(unit = "A", nominal = 10.0) "Measured d-axis current"
    annotation(Placement(transformation(extent = {{100, -60}, {120, -40}})));
  discrete Real random(start = seed, fixed = true) "State of the currents' noise generator";
  discrete Real noise_q(start = 0.0, fixed = true) "Present draw for i_q";
  discrete Real noise_d(start = 0.0, fixed = true) "Present draw for i_d";
protected
  final parameter Real interval(unit = "s") =
    if sigma > 0.0 or resolution > 0.0 then period else NEVER "Ideal sensors need no events";
  discrete Real error_q(unit = "A") "Noise and rounding of the last sample of i_q";
  discrete Real error_d(unit = "A") "Noise and rounding of the last sample of i_d";
equation
  when sample(interval, interval) then
    random = Functions.lehmer(Functions.lehmer(pre(random)));
    noise_q = Functions.normal(Functions.lehmer(pre(random)), random);
    noise_d = Functions.normal_sine(Functions.lehmer(pre(random)), random);
  end when;
  when {initial(), sample(interval, interval)} then
    error_q = Functions.quantized(i_q + sigma * noise_q, resolution) - i_q;
    error_d = Functions.quantized(i_d + sigma * noise_d, resolution) - i_d;
  end when;
  i_q_measured = i_q + error_q;
  i_d_measured = i_d + error_d;
  annotation(
    Icon(graphics = {Line(points = {{-70, -60}, {-35, -60}, {-35, -20}, {0, -20}, {0, 20}, {35, 20}, {35, 60}, {70, 60}}, color = {0, 0, 127}, thickness = 0.5)}),
    Documentation(info = "<html>
<p>As <a href=\"modelica://EMLA.Sensor\">Sensor</a>, with a generator of its own.</p>
</html>"));
end CurrentSensor;

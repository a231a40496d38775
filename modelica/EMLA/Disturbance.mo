within EMLA;
block Disturbance "What acts on a joint from outside: load force, disturbances of torque and voltage"
  extends Interfaces.Block;
  constant Integer levels = 6 "How many levels a load profile can have";

  record Load "Load force: ramps from level to level, with a ripple"
    Real level[levels](each unit = "N") = fill(0.0, levels) "Load force level";
    Real start[levels](each unit = "s") = fill(NEVER, levels) "Time at which a level begins; the first level holds from the beginning";
    Real ramp(unit = "s", min = 1e-6) = 0.5 "Time from one load level to the next";
    Real ripple(unit = "N", min = 0.0) = 0.0 "Width of the load's ripple";
    Real ripple_omega(unit = "rad/s") = 2.0 * pi "Angular frequency of the ripple";
  end Load;

  record D2 "(82); the FMU names these d_2"
    Boolean is_force = false "Whether d_2 is a force in N, not an acceleration in m/s2";
    Real amplitude[2](each unit = "m/s2") = {0.0, 0.0} "Amplitudes of the sines (in N if a force)";
    Real omega[2](each unit = "rad/s") = {0.0, 0.0} "Their angular frequencies";
    Real phase[2](each unit = "rad") = {0.0, 0.0} "Their phases";
    Real arctan(unit = "m/s2") = 0.0 "Factor of arctan(v_L / (1 m/s))";
    Real decay(unit = "1/s", min = 0.0) = 0.0 "Decay of the arctan term";
    Real low(unit = "m/s2") = 0.0 "Lower end of the random value";
    Real high(unit = "m/s2") = 0.0 "Upper end of the random value";
    Real sample_time(unit = "s", min = 1e-9) = 1e-4 "Time for which a random value is held";
    Integer seed(min = 1, max = 2147483646) = 1690412731 "Start of the random sequence";
  end D2;

  record D3 "First line of (83); the FMU names these d_3"
    Real amplitude[2](each unit = "V") = {0.0, 0.0} "Amplitudes of the cosines in d_3";
    Real omega[2](each unit = "rad/s") = {0.0, 0.0} "Their angular frequencies";
    Real phase[2](each unit = "rad") = {0.0, 0.0} "Their phases";
  end D3;

  record D4 "Second line of (83); the FMU names these d_4"
    Real amplitude(unit = "V") = 0.0 "Amplitude of the cosine d_4";
    Real omega(unit = "rad/s") = 0.0 "Its angular frequency";
    Real phase(unit = "rad") = 0.0 "Its phase";
  end D4;

  record Supply "A rectangle of voltage that the supply lacks"
    Real depth(min = 0.0, max = 0.99) = 0.0 "Fraction of the supply voltage by which a sag lowers it";
    Real start(unit = "s") = NEVER "Time at which the sag begins";
    Real duration(unit = "s", min = 0.0) = 1.0 "Duration of the sag";
  end Supply;

  Interfaces.RealInput v_L(unit = "m/s", nominal = 0.1) "Screw speed, for the arctan term"
    annotation(Placement(transformation(extent = {{-120, -10}, {-100, 10}})));
  parameter Load load "Load force";
  parameter D2 d_2_terms "Terms of d_2";
  parameter D3 d_3_terms "Terms of d_3";
  parameter D4 d_4_terms "Term of d_4";
  parameter Supply supply "Sag of the supply";
  discrete Real random(start = d_2_terms.seed, fixed = true) "State of the random generator";
  Interfaces.RealOutput F_L(unit = "N", nominal = 1e4) "Load force, positive against extension"
    annotation(Placement(transformation(extent = {{100, 65}, {120, 85}})));
  Interfaces.RealOutput d_2(unit = "m/s2") "Disturbance of the screw's acceleration"
    annotation(Placement(transformation(extent = {{100, 15}, {120, 35}})));
  Interfaces.RealOutput d_3(unit = "V", nominal = 10.0) "Disturbance of the q-axis voltage"
    annotation(Placement(transformation(extent = {{100, -35}, {120, -15}})));
  Interfaces.RealOutput d_4(unit = "V", nominal = 10.0) "Disturbance of the d-axis voltage"
    annotation(Placement(transformation(extent = {{100, -85}, {120, -65}})));
  Interfaces.RealOutput sag "Missing fraction of the supply voltage"
    annotation(Placement(transformation(extent = {{-10, -120}, {10, -100}}, rotation = -90)));
protected
  final parameter Boolean as_force = d_2_terms.is_force "Whether (82) acts on the load";
  final parameter Real interval(unit = "s") =
    if d_2_terms.high > d_2_terms.low then d_2_terms.sample_time else NEVER "No random part needs no events";
  Real risen[levels] "How far each level has come, between 0 and 1";
  Real profile(unit = "N") "Load force without (82)";
  Real d "(82) in m/s2, or in N if read as a force";
equation
  risen[1] = 1.0;
  for i in 2:levels loop
    risen[i] = Functions.clamp((time - load.start[i]) / load.ramp, 0.0, 1.0);
  end for;
  profile = load.level[1] + sum((load.level[i] - load.level[i - 1]) * risen[i] for i in 2:levels) + 0.5 * load.ripple * sin(load.ripple_omega * time);

  when sample(interval, interval) then
    random = Functions.lehmer(pre(random));
  end when;
  d = sum(d_2_terms.amplitude[i] * sin(d_2_terms.omega[i] * time + d_2_terms.phase[i]) for i in 1:2)
    + d_2_terms.arctan * atan(v_L) * exp(-d_2_terms.decay * time)
    + d_2_terms.low + (d_2_terms.high - d_2_terms.low) * Functions.uniform(random);

  F_L = if as_force then profile - d else profile;
  d_2 = if as_force then 0.0 else d;
  d_3 = sum(d_3_terms.amplitude[i] * cos(d_3_terms.omega[i] * time + d_3_terms.phase[i]) for i in 1:2);
  d_4 = d_4_terms.amplitude * cos(d_4_terms.omega * time + d_4_terms.phase);
  sag = if time >= supply.start and time < supply.start + supply.duration then supply.depth else 0.0;
  annotation(
    Icon(graphics = {Line(points = {{-80, 0}, {-60, 40}, {-40, -30}, {-20, 50}, {0, -50}, {20, 30}, {40, -40}, {60, 20}, {80, 0}}, color = {0, 0, 127}, thickness = 0.5)}),
    Documentation(info = "<html>
<p>Load force profile and the disturbances (82) and (83) of one joint. d_2 is a sum of sines, a decaying arctan of the
speed, and a uniform random value held for <code>d_2_terms.sample_time</code>: the same numbers as in the FMU when that is
stepped by the sample time or less.</p>
<p><code>d_2_terms.is_force</code>: (82) is announced in newtons but enters (26) as an acceleration, the default here. Read
as a force, it is taken off F_L, so that positive values push the actuator out either way.</p>
</html>"));
end Disturbance;

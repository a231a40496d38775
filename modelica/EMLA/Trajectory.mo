within EMLA;
block Trajectory "B-spline of three strokes with its exact derivatives, held before its first and after its last knot"
  extends Interfaces.Block;
  constant Integer coefficients = 48 "How many coefficients a spline can have";
  constant Integer knots = 54 "How many knots it has then";

  record Coefficient "Control points of the strokes; fill up with the last one"
    Real lift[coefficients](each unit = "m") = cat(1, fill(0.244, 3), fill(0.270, 45)) "Coefficient (control point) of the stroke of lift; fill up with the last one";
    Real tilt[coefficients](each unit = "m") = cat(1, fill(0.389, 3), fill(0.442, 45)) "Coefficient (control point) of the stroke of tilt; fill up with the last one";
    Real telescope[coefficients](each unit = "m") = cat(1, fill(0.499, 3), fill(0.348, 45)) "Coefficient (control point) of the stroke of telescope; fill up with the last one";
  end Coefficient;

  parameter Integer degree(min = 1, max = 5) = 5 "Degree of the polynomials";
  parameter Real knot[knots](each unit = "s") = cat(1, fill(0.0, 6), fill(37.7, 48)) "Knots in increasing order, first and last degree + 1 times; fill up with the last one";
  parameter Coefficient coefficient "Control points of the strokes";
  Interfaces.RealOutput x_d[3](each unit = "m", each nominal = 0.1) "Reference position of lift, tilt and telescope"
    annotation(Placement(transformation(extent = {{100, 50}, {120, 70}})));
  Interfaces.RealOutput v_d[3](each unit = "m/s", each nominal = 0.1) "Reference speed of lift, tilt and telescope"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealOutput a_d[3](each unit = "m/s2") "Reference acceleration of lift, tilt and telescope"
    annotation(Placement(transformation(extent = {{100, -70}, {120, -50}})));
protected
  Real t(unit = "s") "Time, but within the knots";
  Real moves "1 within the knots, 0 beyond them";
  Real b[6, knots] "Basis functions of degree 0 to 5; the last ones of a row do not count";
  Real db[6, knots] "Their derivatives";
  Real ddb[6, knots] "Their second derivatives";
  Real B[coefficients] "Basis functions of the spline's degree";
  Real dB[coefficients] "Their derivatives";
  Real ddB[coefficients] "Their second derivatives";
equation
  t = Functions.clamp(time, knot[1], knot[knots]);
  moves = if time >= knot[1] - 1e-9 and time <= knot[knots] + 1e-9 then 1.0 else 0.0;
  for i in 1:knots - 1 loop
    b[1, i] = if knot[i] < knot[i + 1] and knot[i] <= t and (t < knot[i + 1] or knot[i + 1] >= knot[knots]) then 1.0 else 0.0;
  end for;
  b[1, knots] = 0.0;
  for i in 1:knots loop
    db[1, i] = 0.0;
    ddb[1, i] = 0.0;
  end for;
  for p in 1:5 loop
    for i in 1:knots - 1 - p loop
      b[p + 1, i] = Functions.quotient(t - knot[i], knot[i + p] - knot[i]) * b[p, i] + Functions.quotient(knot[i + p + 1] - t, knot[i + p + 1] - knot[i + 1]) * b[p, i + 1];
      db[p + 1, i] = Functions.quotient(p, knot[i + p] - knot[i]) * b[p, i] - Functions.quotient(p, knot[i + p + 1] - knot[i + 1]) * b[p, i + 1];
      ddb[p + 1, i] = Functions.quotient(p, knot[i + p] - knot[i]) * db[p, i] - Functions.quotient(p, knot[i + p + 1] - knot[i + 1]) * db[p, i + 1];
    end for;
    for i in knots - p:knots loop
      b[p + 1, i] = 0.0;
      db[p + 1, i] = 0.0;
      ddb[p + 1, i] = 0.0;
    end for;
  end for;
  for i in 1:coefficients loop
    B[i] = if degree == 1 then b[2, i] else if degree == 2 then b[3, i] else if degree == 3 then b[4, i] else if degree == 4 then b[5, i] else b[6, i];
    dB[i] = if degree == 1 then db[2, i] else if degree == 2 then db[3, i] else if degree == 3 then db[4, i] else if degree == 4 then db[5, i] else db[6, i];
    ddB[i] = if degree == 1 then ddb[2, i] else if degree == 2 then ddb[3, i] else if degree == 3 then ddb[4, i] else if degree == 4 then ddb[5, i] else ddb[6, i];
  end for;
  x_d[1] = sum(B[i] * coefficient.lift[i] for i in 1:coefficients);
  x_d[2] = sum(B[i] * coefficient.tilt[i] for i in 1:coefficients);
  x_d[3] = sum(B[i] * coefficient.telescope[i] for i in 1:coefficients);
  v_d[1] = moves * sum(dB[i] * coefficient.lift[i] for i in 1:coefficients);
  v_d[2] = moves * sum(dB[i] * coefficient.tilt[i] for i in 1:coefficients);
  v_d[3] = moves * sum(dB[i] * coefficient.telescope[i] for i in 1:coefficients);
  a_d[1] = moves * sum(ddB[i] * coefficient.lift[i] for i in 1:coefficients);
  a_d[2] = moves * sum(ddB[i] * coefficient.tilt[i] for i in 1:coefficients);
  a_d[3] = moves * sum(ddB[i] * coefficient.telescope[i] for i in 1:coefficients);
  annotation(
    Icon(graphics = {Line(points = {{-80, -60}, {-40, 50}, {0, -20}, {40, 10}, {80, 60}}, color = {0, 0, 127}, thickness = 0.5, smooth = Smooth.Bezier)}),
    Documentation(info = "<html>
<p>(12) of the paper: q(t, c) = B(t) c with the derivatives of the basis functions B, by the recursion of Cox and
de Boor.</p>
</html>"));
end Trajectory;

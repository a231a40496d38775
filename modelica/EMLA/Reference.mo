within EMLA;
block Reference "Quintic rest-to-rest moves between way-points with dwells, and their exact derivatives"
  extends Interfaces.Block;
  constant Integer moves = 8 "How many moves a reference can have";

  record Move "When the moves take place"
    Real start[moves](each unit = "s") = {0.0, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER} "Time at which a move begins";
    Real duration[moves](each unit = "s", each min = 1e-6) = fill(1.0, moves) "Duration of a move";
  end Move;

  parameter Real waypoint[moves + 1](each unit = "m") = fill(0.0, moves + 1) "Way-point";
  parameter Move move "When the moves take place";
  parameter Real period(unit = "s", min = 0.0) = 0.0 "Period of repetition; 0 is none";
  Interfaces.RealOutput x_d(unit = "m", nominal = 0.1) "Reference position"
    annotation(Placement(transformation(extent = {{100, 50}, {120, 70}})));
  Interfaces.RealOutput v_d(unit = "m/s", nominal = 0.1) "Reference speed"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Interfaces.RealOutput a_d(unit = "m/s2") "Reference acceleration"
    annotation(Placement(transformation(extent = {{100, -70}, {120, -50}})));
protected
  final parameter Real cycle(unit = "s") = if period > 0.0 then period else NEVER;
  final parameter Real d[moves](each unit = "m") = {waypoint[i + 1] - waypoint[i] for i in 1:moves} "Distances";
  Real tau(unit = "s") "Time since the last repetition began";
  Real r[moves] "Progress of each move, between 0 and 1";
equation
  tau = time - cycle * floor(time / cycle);
  for i in 1:moves loop
    r[i] = Functions.clamp((tau - move.start[i]) / move.duration[i], 0.0, 1.0);
  end for;
  x_d = waypoint[1] + sum(d[i] * r[i] ^ 3 * (10.0 - 15.0 * r[i] + 6.0 * r[i] ^ 2) for i in 1:moves);
  v_d = sum(d[i] / move.duration[i] * 30.0 * r[i] ^ 2 * (1.0 - r[i]) ^ 2 for i in 1:moves);
  a_d = sum(d[i] / move.duration[i] ^ 2 * 60.0 * r[i] * (1.0 - r[i]) * (1.0 - 2.0 * r[i]) for i in 1:moves);
  annotation(
    Icon(graphics = {Line(points = {{-80, -60}, {-50, -60}, {-20, -40}, {20, 40}, {50, 60}, {80, 60}}, color = {0, 0, 127}, thickness = 0.5, smooth = Smooth.Bezier)}),
    Documentation(info = "<html>
<p>Move i goes from waypoint[i] to waypoint[i + 1], from move.start[i] for move.duration[i], along
s(r) = 10 r^3 - 15 r^4 + 6 r^5. The paper gives no equation for it: it prints its optimised trajectories as figures
only.</p>
</html>"));
end Reference;

within EMLA;
block HdrmManipulator "Load forces of the 3-DoF manipulator: motion of three actuators in, forces out"
  extends Machine;

  record Screw "From rotary to linear motion"
    Real M_BS[3](each unit = "kg", each min = 0.0) = {156.5, 83.6, 30.4} "Mass of an actuator without its motor";
    Real q_LB[3](each unit = "m") = {0.0, 0.0, 0.0} "Lower end of a stroke";
    Real q_UB[3](each unit = "m") = {0.522, 0.611, 1.0} "Upper end of a stroke";
  end Screw;

  record Motor "Motors"
    Real m[3](each unit = "kg", each min = 0.0) = {45.0, 30.0, 12.0} "Mass, which is fixed to the housing";
  end Motor;

  Interfaces.RealInput x_L[3](each unit = "m", each nominal = 0.1) "Stroke"
    annotation(Placement(transformation(extent = {{-120, 70}, {-100, 90}})));
  Interfaces.RealInput v_L[3](each unit = "m/s", each nominal = 0.1) "Speed of a stroke"
    annotation(Placement(transformation(extent = {{-120, 20}, {-100, 40}})));
  Interfaces.RealInput a_L[3](each unit = "m/s2") "Acceleration of a stroke"
    annotation(Placement(transformation(extent = {{-120, -30}, {-100, -10}})));
  parameter Screw screw "Screws";
  parameter Motor motor "Motors";
  Interfaces.RealOutput F_L[3](each unit = "N", each nominal = 1e4) "Load force, positive against extension"
    annotation(Placement(transformation(extent = {{100, -10}, {120, 10}})));
equation
  for i in 1:3 loop
    q[i] = x_L[i];
    v[i] = v_L[i];
    a[i] = a_L[i];
    M_BS[i] = screw.M_BS[i];
    m_motor[i] = motor.m[i];
    F_L[i] = f[i];
  end for;
  annotation(Icon(graphics = {
    Line(points = {{-60, -60}, {0, 20}, {60, -20}}, color = {60, 60, 60}, thickness = 2.0),
    Text(extent = {{-90, -65}, {90, -90}}, textString = "manipulator", lineColor = {60, 60, 60})}));
end HdrmManipulator;

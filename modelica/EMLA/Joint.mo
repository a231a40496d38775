within EMLA;
model Joint "One joint: reference, plant, disturbance, observer and controller, connected"
  parameter Actuator emla "The actuator, for the plant and for those who know it";
  Reference reference "The motion that the joint shall follow"
    annotation(Placement(transformation(extent = {{-150, -60}, {-110, -20}})));
  Plant plant(
    motor(R_s = emla.R_s, L_d = emla.L_d, L_q = emla.L_q, Phi_PM = emla.Phi_PM, N_p = emla.N_p, J_m = emla.J_m, B_m = emla.B_m,
      i_max = emla.i_range),
    coupling(J_c = emla.J_c),
    gearbox(rho = emla.rho, J_GB = emla.J_GB, eta_GB = emla.eta_GB),
    screw(lead = emla.lead, M_BS = emla.M_BS, B_BS = emla.B_BS, C_eq = emla.C_eq,
      q_LB = emla.q_LB, q_UB = emla.q_UB, v_max = emla.v_max),
    inverter(u_max = emla.u_max))
    "The actuator with its sensors"
    annotation(Placement(transformation(extent = {{70, -30}, {130, 30}})));
  Disturbance disturbance "What acts on the joint from outside"
    annotation(Placement(transformation(extent = {{0, -90}, {40, -50}})));
  Observer observer(
    known(N_p = emla.N_p, Phi_PM = emla.Phi_PM, A_eq = emla.A_eq, B_eq = emla.B_eq))
    "Observer of position and speed"
    annotation(Placement(transformation(extent = {{0, 50}, {-40, 90}})));
  RsbaController controller(
    known(
      R_s = emla.R_s, L_d = emla.L_d, L_q = emla.L_q, Phi_PM = emla.Phi_PM, N_p = emla.N_p,
      alpha_RL = emla.alpha_RL, A_eq = emla.A_eq, B_eq = emla.B_eq, C_eq = emla.C_eq))
    "Controller"
    annotation(Placement(transformation(extent = {{-50, -30}, {10, 30}})));
equation
  connect(reference.x_d, controller.x_d)
    annotation(Line(points = {{-108, -28}, {-90, -28}, {-90, -9}, {-53, -9}}, color = {0, 0, 127}));
  connect(reference.v_d, controller.v_d)
    annotation(Line(points = {{-108, -40}, {-84, -40}, {-84, -18}, {-53, -18}}, color = {0, 0, 127}));
  connect(reference.a_d, controller.a_d)
    annotation(Line(points = {{-108, -52}, {-78, -52}, {-78, -27}, {-53, -27}}, color = {0, 0, 127}));
  connect(disturbance.F_L, plant.F_L)
    annotation(Line(points = {{42, -55}, {46, -55}, {46, 0}, {67, 0}}, color = {0, 0, 127}));
  connect(disturbance.d_2, plant.d_2)
    annotation(Line(points = {{42, -65}, {50, -65}, {50, -9}, {67, -9}}, color = {0, 0, 127}));
  connect(disturbance.d_3, plant.d_3)
    annotation(Line(points = {{42, -75}, {54, -75}, {54, -18}, {67, -18}}, color = {0, 0, 127}));
  connect(disturbance.d_4, plant.d_4)
    annotation(Line(points = {{42, -85}, {58, -85}, {58, -27}, {67, -27}}, color = {0, 0, 127}));
  connect(plant.v_L, disturbance.v_L)
    annotation(Line(points = {{133, 21}, {148, 21}, {148, -100}, {-10, -100}, {-10, -70}, {-2, -70}}, color = {0, 0, 127}));
  connect(plant.x_measured, observer.y)
    annotation(Line(points = {{133, -9}, {154, -9}, {154, 80}, {2, 80}}, color = {0, 0, 127}));
  connect(disturbance.sag, plant.sag)
    annotation(Line(points = {{20, -92}, {20, -104}, {82, -104}, {82, -33}}, color = {0, 0, 127}));
  connect(plant.i_q_measured, observer.i_q)
    annotation(Line(points = {{97, -33}, {97, -60}, {158, -60}, {158, 70}, {2, 70}}, color = {0, 0, 127}));
  connect(plant.inverter.u_available, controller.u_available)
    annotation(Line(points = {{121, -33}, {121, -88}, {-60, -88}, {-60, 33}, {-53, 33}}, color = {0, 0, 127}));
  connect(observer.d_hat, controller.d_hat)
    annotation(Line(points = {{-20, 92}, {-20, 96}, {-86, 96}, {-86, -33}, {-53, -33}}, color = {0, 0, 127}));
  connect(plant.i_q_measured, controller.i_q)
    annotation(Line(points = {{97, -33}, {97, -96}, {-70, -96}, {-70, 9}, {-53, 9}}, color = {0, 0, 127}));
  connect(plant.i_d_measured, controller.i_d)
    annotation(Line(points = {{109, -33}, {109, -92}, {-64, -92}, {-64, 0}, {-53, 0}}, color = {0, 0, 127}));
  connect(controller.u_q, plant.u_q)
    annotation(Line(points = {{13, 27}, {67, 27}}, color = {0, 0, 127}));
  connect(controller.u_d, plant.u_d)
    annotation(Line(points = {{13, 18}, {67, 18}}, color = {0, 0, 127}));
  connect(controller.i_q_ref, plant.i_q_ref)
    annotation(Line(points = {{13, 9}, {67, 9}}, color = {0, 0, 127}));
  connect(controller.i_q_ref, observer.i_q_ref)
    annotation(Line(points = {{13, 9}, {30, 9}, {30, 60}, {2, 60}}, color = {0, 0, 127}));
  connect(observer.x_hat, controller.x_hat)
    annotation(Line(points = {{-42, 86}, {-80, 86}, {-80, 27}, {-53, 27}}, color = {0, 0, 127}));
  connect(observer.v_hat, controller.v_hat)
    annotation(Line(points = {{-42, 78}, {-74, 78}, {-74, 18}, {-53, 18}}, color = {0, 0, 127}));
  annotation(
    Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {60, 60, 60}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-70, 30}, {0, -30}}, lineColor = {60, 60, 60}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{0, 10}, {75, -10}}, lineColor = {60, 60, 60}, fillColor = {225, 225, 225}, fillPattern = FillPattern.Solid),
      Text(extent = {{-150, 145}, {150, 105}}, textString = "%name", lineColor = {0, 0, 255})}),
    Diagram(coordinateSystem(extent = {{-160, -110}, {160, 100}})),
    Documentation(info = "<html>
<p>Observer in the loop: the controller is given x_hat and v_hat. The block's defaults, printed laws and gains, are for
reading; <a href=\"modelica://EMLA.StudyJoint\">StudyJoint</a> has the repaired ones.</p>
</html>"));
end Joint;

within EMLA;
model StudyJoint "What the joints of the study share: repaired laws and gains, uncertainties, voltage disturbances"
  extends Joint(
    plant(uncertainty(F_2 = 0.01, F_3 = 0.002, F_4 = 0.001)),
    disturbance(
      d_3_terms(amplitude = {0.42, 0.032}, omega = {8.0, 5.0}, phase = {pi / 3.0, -pi / 2.0}),
      d_4_terms(amplitude = -0.15, omega = 12.0, phase = pi / 6.0)),
    observer(
      alpha_1 = 2.0 * w,
      alpha_2 = w * w,
      Q_11 = 1.0,
      Q_12 = 0.0,
      Q_22 = 1.0,
      H_0 = 1.0,
      m_0 = 16.0 / (w * w),
      use_model = false),
    controller(
      zeta = {100.0, 100.0, 100.0, 100.0},
      delta = {1.0, 1.0, 1.0, 1.0},
      sigma = {1.0, 1.0, 1.0, 1.0},
      x_2d_in_a_1 = false,
      feed_acceleration = true,
      limit_acceleration = true,
      limit_current = true,
      limit_voltage = true,
      freeze_adaptation = true));
  constant Real w(unit = "rad/s") = 4000.0 "Both poles of the observer are at -w";
  constant Real encoder_steps = 2.0 ^ 20 "Steps per motor turn of the position sensor (assumed)";
  annotation(Documentation(info = "<html>
<p>The repaired (&quot;robust&quot;) gains of controller and observer, the uncertainties (84), the voltage disturbances
(83) and a 20-bit encoder.</p>
</html>"));
end StudyJoint;

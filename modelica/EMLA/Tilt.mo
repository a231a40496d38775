within EMLA;
model Tilt "The tilt joint of the study"
  extends StudyJoint(
    emla(
      R_s = 0.16,
      L_d = 3.2e-3,
      L_q = 3.2e-3,
      Phi_PM = 0.13,
      N_p = 8,
      J_m = 0.0105,
      tau_max = 129.0,
      rho = 1.0 / 5.0,
      lead = 0.01,
      M_BS = 83.6,
      q_UB = 0.611,
      v_max = 0.100,
      u_max = sqrt(2.0) * 300.0),
    reference(
      waypoint = {0.389, 0.442, 0.442, 0.442, 0.442, 0.442, 0.442, 0.442, 0.442},
      move(duration = {15.0 * (0.442 - 0.389) / (8.0 * 0.0808), 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0})),
    plant(start(x_L = 0.385), sensor(resolution = emla.rho * emla.lead / encoder_steps, seed = 715827883)),
    disturbance(
      load(level = fill(25e3, 6)),
      d_2_terms(amplitude = {0.8, 0.95}, omega = {7.0, 18.0}, low = 0.0, high = 2.0, seed = 715827883)),
    observer(start(x_hat = 0.385)),
    controller(beta = {600.0, 1200.0, 5000.0, 5000.0}, limit(a_max = 1.2, i_max = emla.i_max, u_max = emla.u_max, v_max = emla.v_max)));
  annotation(experiment(StartTime = 0.0, StopTime = 10.0, Tolerance = 1e-6, Interval = 1e-3));
end Tilt;

within EMLA;
model Telescope "The telescope joint of the study"
  extends StudyJoint(
    emla(
      R_s = 0.35,
      L_d = 12e-3,
      L_q = 12e-3,
      Phi_PM = 0.12,
      N_p = 6,
      J_m = 0.00085,
      tau_max = 32.0,
      rho = 1.0,
      lead = 0.01,
      M_BS = 30.4,
      q_UB = 1.0,
      v_max = 0.210,
      u_max = sqrt(2.0) * 600.0),
    reference(
      waypoint = {0.499, 0.348, 0.348, 0.348, 0.348, 0.348, 0.348, 0.348, 0.348},
      move(duration = {15.0 * (0.499 - 0.348) / (8.0 * 0.210), 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0})),
    plant(start(x_L = 0.5), sensor(resolution = emla.rho * emla.lead / encoder_steps, seed = 1327217885)),
    disturbance(
      load(level = fill(-3.4e3, 6)),
      d_2_terms(amplitude = {0.9, -0.3}, omega = {65.0, 50.0}, phase = {0.0, pi / 4.0}, seed = 1327217885)),
    observer(start(x_hat = 0.5)),
    controller(beta = {1000.0, 2500.0, 5000.0, 5000.0}, limit(a_max = 10.0, i_max = emla.i_max, u_max = emla.u_max, v_max = emla.v_max)));
  annotation(experiment(StartTime = 0.0, StopTime = 10.0, Tolerance = 1e-6, Interval = 1e-3));
end Telescope;

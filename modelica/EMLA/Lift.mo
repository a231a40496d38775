within EMLA;
model Lift "The lift joint of the study"
  extends StudyJoint(
    emla(
      R_s = 0.14,
      L_d = 2.4e-3,
      L_q = 2.4e-3,
      Phi_PM = 0.15,
      N_p = 8,
      J_m = 0.016,
      tau_max = 190.0,
      rho = 1.0 / 7.0,
      lead = 0.02,
      M_BS = 156.5,
      q_UB = 0.522,
      v_max = 0.136,
      u_max = sqrt(2.0) * 315.0),
    reference(
      waypoint = {0.244, 0.270, 0.270, 0.270, 0.270, 0.270, 0.270, 0.270, 0.270},
      move(duration = {15.0 * (0.270 - 0.244) / (8.0 * 0.0607), 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0})),
    plant(start(x_L = 0.240), sensor(resolution = emla.rho * emla.lead / encoder_steps, seed = 1690412731)),
    disturbance(
      load(level = fill(57e3, 6)),
      d_2_terms(amplitude = {0.8, 0.7}, omega = {8.0, 20.0}, arctan = 1.2, decay = 3.0, seed = 1690412731)),
    observer(start(x_hat = 0.240)),
    controller(beta = {800.0, 2000.0, 5000.0, 5000.0}, limit(a_max = 1.2, i_max = emla.i_max, u_max = emla.u_max, v_max = emla.v_max)));
  annotation(experiment(StartTime = 0.0, StopTime = 10.0, Tolerance = 1e-6, Interval = 1e-3));
end Lift;

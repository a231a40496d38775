within EMLA;
record Actuator "One EMLA: motor, gearbox, screw and inverter"
  extends Interfaces.Data;
  Real R_s(unit = "Ohm") = 0.14 "Stator resistance per phase";
  Real L_d(unit = "H") = 2.4e-3 "d-axis inductance";
  Real L_q(unit = "H") = 2.4e-3 "q-axis inductance";
  Real Phi_PM(unit = "Wb") = 0.15 "Permanent magnet flux linkage (peak)";
  Integer N_p = 8 "Number of pole pairs";
  Real J_m(unit = "kg.m2") = 0.016 "Rotor inertia";
  Real tau_max(unit = "N.m") = 190.0 "Largest motor torque";
  Real rho = 1.0 / 7.0 "Screw turns per motor turn";
  Real lead(unit = "m") = 0.02 "Screw travel per turn";
  Real M_BS(unit = "kg") = 156.5 "Mass moved by the screw";
  Real q_LB(unit = "m") = 0.0 "Lower end of the stroke";
  Real q_UB(unit = "m") = 0.522 "Upper end of the stroke";
  Real v_max(unit = "m/s") = 0.136 "Largest speed of the screw";
  Real u_max(unit = "V") = sqrt(2.0) * 315.0 "Longest voltage vector of the inverter: u_N read as rms";
  Real eta_GB = 0.9 "Efficiency of gearbox and screw (assumed)";
  Real B_m(unit = "N.m.s/rad") = 1.67e-3 "Viscous friction of the rotor (a Siemens 1FT6084, a motor of this size)";
  Real J_c(unit = "kg.m2") = 0.0 "Coupling inertia (assumed)";
  Real J_GB(unit = "kg.m2") = 0.0 "Gearbox inertia at the motor (assumed)";
  Real B_BS(unit = "N.s/m") = 0.0 "Viscous friction of the screw (assumed)";
  Real C_eq(unit = "N") = 0.0 "Motor torque per screw travel (rigid screw)";
  Real alpha_RL(unit = "rad/m") = Functions.alpha_RL(rho, lead) "Motor angle per travel";
  Real A_eq(unit = "kg.m") = Functions.A_eq(alpha_RL, J_m + J_c + J_GB, M_BS) "Equivalent inertia";
  Real B_eq(unit = "kg.m/s") = Functions.B_eq(alpha_RL, B_m, B_BS) "Equivalent friction";
  Real i_max(unit = "A") = tau_max / (1.5 * N_p * Phi_PM) "q-axis current that gives tau_max";
  Real i_range(unit = "A") = 1.5 * i_max "Range of the motor's d-q currents (assumed)";
  annotation(Documentation(info = "<html>
<p>The numbers are the lift's column of the paper's Table IV, the stroke's that of Table II. d-q quantities are amplitude-invariant (peak). A joint gives
them to the plant, and to observer and controller as what they know.</p>
</html>"));
end Actuator;

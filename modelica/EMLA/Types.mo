within EMLA;
package Types "Choices"
  type TorqueSource = enumeration(
    current "The actual current (equation:PMSM): physics",
    command "The commanded current i_q* (equation:StateSpace3): the paper's idealisation")
    "Which q-axis current drives the screw";

  type DisturbanceReading = enumeration(
    acceleration "(98) in m/s2, as it enters (26)",
    force "(98) in N, as the paper announces it")
    "What (98) is";
end Types;

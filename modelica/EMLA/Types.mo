within EMLA;
package Types "Choices"
  type TorqueSource = enumeration(
    current "The actual current (3): physics",
    command "The commanded current i_q* (9): the paper's idealisation")
    "Which q-axis current drives the screw";

  type DisturbanceReading = enumeration(
    acceleration "(82) in m/s2, as it enters (26)",
    force "(82) in N, as the paper announces it")
    "What (82) is";
end Types;

within EMLA;
package Functions "From rotary to linear motion, limits and pseudo-random numbers"
  function alpha_RL "Motor angle per screw travel (4)"
    input Real rho "Screw turns per motor turn";
    input Real lead(unit = "m") "Screw travel per turn";
    output Real y(unit = "rad/m");
  algorithm
    y := 2.0 * pi / (rho * lead);
  end alpha_RL;

  function A_eq "Motor torque per screw acceleration (6)"
    input Real alpha_RL(unit = "rad/m");
    input Real J(unit = "kg.m2") "J_m + J_c + J_GB";
    input Real M_BS(unit = "kg") "Mass moved by the screw";
    output Real y(unit = "kg.m");
  algorithm
    y := alpha_RL * (J + M_BS / (alpha_RL * alpha_RL));
  end A_eq;

  function B_eq "Motor torque per screw speed (6)"
    input Real alpha_RL(unit = "rad/m");
    input Real B_m(unit = "N.m.s/rad") "Viscous friction of the rotor";
    input Real B_BS(unit = "N.s/m") "Viscous friction of the screw";
    output Real y(unit = "kg.m/s");
  algorithm
    y := alpha_RL * (B_m + B_BS / (alpha_RL * alpha_RL));
  end B_eq;

  function C_eq "Stiffness of the drive train as printed (6)"
    input Real alpha_RL(unit = "rad/m");
    input Real rho "Screw turns per motor turn";
    input Real k_tau[3](each unit = "N.m/rad") "Torsional stiffnesses k_tau1 to k_tau3";
    input Real k_L(unit = "N/m") "Linear stiffness";
    output Real y(unit = "N/m");
  algorithm
    y := alpha_RL * alpha_RL / (1.0 / k_tau[1] + 1.0 / k_tau[2] + 1.0 / (rho * rho * k_tau[3]) + alpha_RL * alpha_RL / k_L);
    annotation(Documentation(info = "<html>
<p>The printed formula gives N/m where (5) needs a torque per travel, N. Either way it ties the load to the ground: with
realistic stiffnesses no motor could move it. The plant's default is a rigid screw, C_eq = 0.</p>
</html>"));
  end C_eq;

  function D_eq "Motor torque per load force (6)"
    input Real alpha_RL(unit = "rad/m");
    input Real eta_GB "Efficiency of gearbox and screw";
    output Real y(unit = "m");
  algorithm
    y := 1.0 / (alpha_RL * eta_GB);
  end D_eq;

  function k_L "Stiffness of bearing, screw, nut and tube in series (7)"
    input Real bearing(unit = "N/m");
    input Real screw(unit = "N/m");
    input Real nut(unit = "N/m");
    input Real tube(unit = "N/m");
    output Real y(unit = "N/m");
  algorithm
    y := 1.0 / (1.0 / bearing + 1.0 / screw + 1.0 / nut + 1.0 / tube);
  end k_L;

  function quotient "A ratio; 0 where the divisor is 0"
    input Real x;
    input Real d;
    output Real y;
  algorithm
    y := if d > 0.0 then x / d else 0.0;
  end quotient;

  function clamp "The value, but not below low nor above high"
    input Real x;
    input Real low;
    input Real high;
    output Real y;
  algorithm
    y := min(max(x, low), high);
  end clamp;

  function shortening "Factor that shortens the vector (x, y) to a length of at most limit > 0"
    input Real x;
    input Real y;
    input Real limit;
    output Real scale "1 where the vector is not too long";
  algorithm
    scale := limit / max(sqrt(x * x + y * y), limit);
  end shortening;

  function lehmer "Next state of the generator of Park and Miller (CACM 31, 1988)"
    input Real x "Whole number between 1 and 2^31 - 2";
    output Real next "16807 x mod (2^31 - 1), exact in Real";
  algorithm
    next := mod(16807.0 * x, 2147483647.0);
  end lehmer;

  function uniform "State of the generator as a number strictly between 0 and 1"
    input Real x "State of the generator";
    output Real y;
  algorithm
    y := x / 2147483647.0;
  end uniform;

  function normal "Two states of the generator as one draw from N(0, 1) (Box and Muller, 1958)"
    input Real x1 "State of the generator";
    input Real x2 "State of the generator";
    output Real y;
  algorithm
    y := sqrt(-2.0 * log(uniform(x1))) * cos(2.0 * pi * uniform(x2));
  end normal;

  function normal_sine "The other draw of the same two states, independent of the first"
    input Real x1 "State of the generator";
    input Real x2 "State of the generator";
    output Real y;
  algorithm
    y := sqrt(-2.0 * log(uniform(x1))) * sin(2.0 * pi * uniform(x2));
  end normal_sine;

  function smooth_sign "A smooth sign, linear well within a width"
    input Real x;
    input Real width "More than 0";
    output Real y "Between -1 and 1";
  algorithm
    y := x / sqrt(x * x + width * width);
  end smooth_sign;

  function friction "Coulomb and Stribeck friction, against the speed (the form of Hess and Soom, 1990)"
    input Real v(unit = "m/s");
    input Real F_C(unit = "N") "Coulomb friction";
    input Real F_S(unit = "N") "Friction that breaks away";
    input Real v_S(unit = "m/s") "Speed halfway between the two";
    input Real v_0(unit = "m/s") "Speed below which friction acts like a damper";
    output Real F(unit = "N");
  algorithm
    F := (F_C + (F_S - F_C) / (1.0 + (v / v_S) * (v / v_S))) * smooth_sign(v, v_0);
  end friction;

  function felt_load "The load as the motor feels it, through gears whose losses go against the motion"
    input Real F_L(unit = "N") "Load force";
    input Real v(unit = "m/s");
    input Real eta_GB "Efficiency where the motor drives";
    input Real eta_back "Efficiency where the load drives; 0 is 2 - 1 / eta_GB";
    input Real v_0(unit = "m/s") "Speed within which the losses vanish";
    output Real F(unit = "N") "F_L / eta_GB, eta_back F_L, or F_L at rest";
  protected
    Real forward "Loss where the motor drives";
    Real backward "Loss where the load drives";
    Real s "Smooth sign of the speed";
  algorithm
    forward := 1.0 / eta_GB - 1.0;
    backward := if eta_back == 0.0 then forward else 1.0 - eta_back;
    s := smooth_sign(v, v_0);
    F := F_L + 0.5 * (forward + backward) * abs(F_L) * s + 0.5 * (forward - backward) * F_L * s * s;
  end felt_load;

  function end_stop "Force of a stop that is pressed in (Hunt and Crossley, 1975), which never pulls"
    input Real depth(unit = "m") "At least 0";
    input Real approach(unit = "m/s") "Its rate";
    input Real stiffness(unit = "N/m2");
    input Real damping(unit = "s/m");
    output Real F(unit = "N");
  protected
    Real z "Relative growth of the force";
  algorithm
    z := damping * approach;
    F := stiffness * depth * depth * (if z >= 0.0 then 1.0 + z else 1.0 / (1.0 + abs(z)));
  end end_stop;

  function quantized "Value rounded to a resolution; 0 is no rounding"
    input Real x;
    input Real resolution;
    output Real y;
  algorithm
    y := if resolution > 0.0 then resolution * floor(x / resolution + 0.5) else x;
  end quantized;
end Functions;

within ;
package EMLA "Electromechanical linear actuators with observer and RSBA controller"
  constant Real NEVER(unit = "s") = 1e9 "Start of what does not happen unless somebody says when";
  constant Real pi = 3.14159265358979323846 "Ratio of a circle's circumference to its diameter";

  annotation(
    version = "0.2.0",
    Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {60, 60, 60}, fillColor = {245, 245, 245}, fillPattern = FillPattern.Solid, radius = 20),
      Rectangle(extent = {{-80, 40}, {0, -40}}, lineColor = {60, 60, 60}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{0, 12}, {85, -12}}, lineColor = {60, 60, 60}, fillColor = {225, 225, 225}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>The equations of the EMLA-Cosim FMUs in continuous time: the PMSM-driven electromechanical linear actuator
(<a href=\"modelica://EMLA.Plant\">Plant</a>, its electrical half alone
<a href=\"modelica://EMLA.Motor\">Motor</a>), its adaptive robust observer
(<a href=\"modelica://EMLA.Observer\">Observer</a>) and the robust subsystem-based adaptive controller
(<a href=\"modelica://EMLA.RsbaController\">RsbaController</a>), connected to a joint
(<a href=\"modelica://EMLA.Joint\">Joint</a>) and to the study of three joints
(<a href=\"modelica://EMLA.Study\">Study</a>).</p>
<p>Numbers in parentheses are the equations of the paper, as printed: Mehdi Heydari Shahna, Mohammad Bahari and Jouni
Mattila, <em>Robustness-Guaranteed Observer-Based Control Strategy with Modularity for Cleantech EMLA-Driven Heavy-Duty
Robotic Manipulator</em>. Parameters and variables have the names, units, start values and ranges of the FMUs. Other names were needed in two places: <code>known</code> is <code>model</code> in the
FMUs, which is a keyword here, and <code>d_2_terms</code>, <code>d_3_terms</code>, <code>d_4_terms</code> hold the
parameters that the FMU names <code>d_2.</code>, <code>d_3.</code> and <code>d_4.</code>, because d_2, d_3 and d_4 are
outputs.</p>
<p>The FMUs exchange values once per communication step and hold them in between. Here all signals act at once, and only
the sensor and the random part of d_2 are sampled.</p>
</html>"));
end EMLA;

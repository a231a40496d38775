within EMLA;
package Interfaces "Connectors and the look of a block"
  connector RealInput = input Real "Real input"
    annotation(
      defaultComponentName = "u",
      Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
        Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {0, 0, 127}, fillColor = {0, 0, 127}, fillPattern = FillPattern.Solid)}),
      Diagram(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
        Polygon(points = {{0, 50}, {100, 0}, {0, -50}}, lineColor = {0, 0, 127}, fillColor = {0, 0, 127}, fillPattern = FillPattern.Solid),
        Text(extent = {{-10, 60}, {-10, 85}}, textString = "%name", lineColor = {0, 0, 127})}));

  connector RealOutput = output Real "Real output"
    annotation(
      defaultComponentName = "y",
      Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
        Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid)}),
      Diagram(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
        Polygon(points = {{-100, 50}, {0, 0}, {-100, -50}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Text(extent = {{30, 60}, {30, 110}}, textString = "%name", lineColor = {0, 0, 127})}));

  partial block Block "Box with the component's name"
    annotation(Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{-150, 145}, {150, 105}}, textString = "%name", lineColor = {0, 0, 255})}));
  end Block;

  partial record Data "Sheet with the component's name"
    annotation(Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 60}, {100, -60}}, lineColor = {64, 64, 64}, fillColor = {255, 215, 136}, fillPattern = FillPattern.Solid),
      Line(points = {{-100, 20}, {100, 20}}, color = {64, 64, 64}),
      Text(extent = {{-150, 105}, {150, 65}}, textString = "%name", lineColor = {0, 0, 255})}));
  end Data;
end Interfaces;

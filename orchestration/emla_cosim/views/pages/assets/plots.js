// Draw each plot when it becomes visible. bokeh_plots.py makes the figures; this script fills them with data.
"use strict";
const drawn = new Map(); // figure elements with their plots

const plots = (() => {
  const parsed = (id) => JSON.parse(document.getElementById(id).textContent);
  const shown = (v) => (Number.isFinite(v) ? String(Number(v.toPrecision(6))) : "–");
  const make = (tag, className, text) =>
    Object.assign(document.createElement(tag), { className, textContent: text ?? "" });

  const probe = make("i", "probe");
  const color = (name) => {
    // the current theme of the page
    probe.style.color = `var(--${name})`;
    return getComputedStyle(probe).color;
  };

  function withBokeh() {
    if (!globalThis.Bokeh) {
      const script = document.createElement("script");
      script.textContent = document.getElementById("bokeh").textContent;
      document.head.append(script);
      Bokeh.logger.set_level?.("error");
    }
    return Bokeh;
  }

  async function draw(element, given) {
    if (drawn.has(element)) return;
    drawn.set(element, null);
    const data = given ?? parsed(`${element.dataset.plot}-data`);
    const canvas = make("div", "canvas");
    element.replaceChildren(canvas);
    const views = await withBokeh().embed.embed_item(parsed(`figure-${data.shape}`), canvas);
    const plot = views.roots[0].model;
    const model = (name) => plot.document.get_model_by_name(name);
    if (data.since) model("since").setv({ location: data.since.at, visible: true });
    const one = { element, plot, model, given: curves.read(data), unit: data.unit };
    one.data = one.given;
    if (!element.isConnected) return drawn.delete(element);
    drawn.set(element, one);
    const button = legend(one);
    show(one, one.given);
    if (data.since && button && curves.thin(one.given)) button.click();
    limit(one);
    paint(one);
    if (data.group) join(one);
    plot.on_event("doubletap", () => view(one));
    element.addEventListener("keydown", (event) => keys(one, event));
    element.dataset.drawn = "yes";
  }

  function show(one, data) {
    const { plot, model } = one;
    one.data = data;
    data.lines.forEach(({ x, y }, k) => {
      model(`line-${k}-data`).data = { x, y };
    });
    if (data.band)
      model("band-data").data = { x: data.band.x, lower: data.band.lower, upper: data.band.upper };
    if (data.mark) model("mark-data").data = { x: [data.mark.x], y: [data.mark.y] };
    plot.left[0].axis_label = one.unit;
    view(one);
  }

  function view({ plot, data }) {
    // the whole range, which reset restores
    for (const [range, [start, end]] of [
      [plot.x_range, data.x],
      [plot.y_range, data.y],
    ])
      range.setv({ start, end, reset_start: start, reset_end: end });
  }

  function limit({ model, data }) {
    // shade the area beyond the limit
    for (const [k, { low, high }] of data.limits.entries()) {
      if (low !== null) model(`limit-${k}-low`).setv({ top: low, visible: true });
      if (high !== null) model(`limit-${k}-high`).setv({ bottom: high, visible: true });
      for (const [end, at] of Object.entries({ low, high }))
        if (at !== null) model(`limit-${k}-${end}-edge`).setv({ location: at, visible: true });
    }
  }

  // Plots of a group show the same time range; followers show all values in it.
  let leading = false;
  function join(one) {
    const range = one.plot.x_range;
    const others = () =>
      [...drawn.values()].filter((o) => o && o !== one && o.data.group === one.data.group);
    const [other] = others();
    if (other) follow(one, other.plot.x_range);
    range.change.connect(() => {
      if (leading) return;
      leading = true;
      for (const other of others()) follow(other, range);
      leading = false;
    });
  }

  function follow({ plot, data, model }, { start, end }) {
    const [first, last] = data.x;
    plot.x_range.setv({ start, end });
    if (start <= first && last <= end) return plot.y_range.setv({ start: data.y[0], end: data.y[1] });
    let low = Infinity,
      high = -Infinity;
    for (const [k, line] of data.lines.entries()) {
      if (!model(`line-${k}`).visible) continue;
      const [least, most] = curves.extent(line, start, end);
      low = Math.min(low, least);
      high = Math.max(high, most);
    }
    const room = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1;
    if (low <= high) plot.y_range.setv({ start: low - room, end: high + room });
  }

  function keys(one, event) {
    const { plot } = one;
    const range = plot.x_range,
      width = range.end - range.start,
      middle = (range.start + range.end) / 2;
    const to = {
      "+": [middle - width / 4, middle + width / 4],
      "-": [middle - width, middle + width],
      ArrowLeft: [range.start - width / 8, range.end - width / 8],
      ArrowRight: [range.start + width / 8, range.end + width / 8],
    }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "0") view(one);
    else if (to) range.setv({ start: to[0], end: to[1] });
    else return;
    event.preventDefault();
  }

  function paint({ plot, data, model }) {
    const ink = color("soft"),
      line = color("line"),
      font = getComputedStyle(document.body).fontFamily;
    for (const axis of [...plot.below, ...plot.left])
      axis.setv({
        axis_label_text_color: ink,
        major_label_text_color: ink,
        axis_line_color: line,
        major_tick_line_color: line,
        axis_label_text_font: font,
        major_label_text_font: font,
        axis_label_text_font_size: "12px",
        major_label_text_font_size: "11px",
      });
    for (const grid of plot.center) if (grid.dimension === 1) grid.grid_line_color = line;
    data.lines.forEach((curve, k) =>
      model(`line-${k}`).glyph.setv({
        line_color: color(curve.color),
        line_dash: curve.dashed ? [5, 3] : [],
      }),
    );
    if (data.band) {
      model("band").glyph.setv({ fill_color: color("band"), fill_alpha: 1 });
      for (const edge of ["lower", "upper"]) model(`band-${edge}`).glyph.line_color = color("band-edge");
    }
    for (const k of data.limits.keys())
      for (const end of ["low", "high"]) {
        model(`limit-${k}-${end}`).setv({ fill_color: color("red"), fill_alpha: 0.08 });
        model(`limit-${k}-${end}-edge`).setv({ line_color: color("red"), line_alpha: 0.6 });
      }
    model("mark").glyph.line_color = color("red");
    model("since").line_color = color("red");
    model("crosshair").line_color = ink;
  }

  // Legend with the values at the mouse pointer.
  function legend(one) {
    const { element, plot, data, model } = one;
    const list = make("figcaption", "legend"),
      entries = [];
    const entry = (label, className, curve, told, toggled) => {
      const item = make(toggled ? "button" : "span", "entry"),
        swatch = make("i", `swatch ${className}`),
        value = make("span", "value");
      item.append(swatch, make("bdi", "", label), value);
      list.append(item);
      entries.push([value, curve, told]);
      if (toggled) {
        Object.assign(item, { type: "button", ariaPressed: "true", title: "Show or hide this line" });
        item.addEventListener("click", () => {
          const on = item.ariaPressed !== "true";
          item.ariaPressed = String(on);
          toggled(on);
        });
      }
      return swatch;
    };
    const time = make("span", "entry at");
    for (const [k, line] of data.lines.entries()) {
      const gaps = line.missing ? `, ${line.missing} point${line.missing === 1 ? "" : "s"} not drawn` : "";
      const swatch = entry(
        line.label + gaps,
        line.dashed ? "dashed" : "",
        () => one.data.lines[k],
        (curve, i) => shown(curve.y[i]),
        data.lines.length > 1 && ((visible) => (model(`line-${k}`).visible = visible)),
      );
      swatch.style.setProperty("--swatch", `var(--${line.color})`);
    }
    if (data.band)
      entry(
        data.band.label,
        "filled",
        () => one.data.band,
        (curve, i) => `${shown(curve.lower[i])} … ${shown(curve.upper[i])}`,
      );
    for (const { label, low, high } of data.limits) {
      const ends = [low, high].map((end) => (end === null ? "" : shown(end)));
      entry(`${label} ${ends.join(" … ")}`, "limit");
    }
    if (data.mark) entry(`${data.mark.label} at ${shown(data.mark.x)} s`, "ring");
    if (data.since) entry(`${data.since.label} at ${shown(data.since.at)} s`, "upright");
    list.append(time);
    const button = data.base === null ? null : switcher(one);
    if (button) list.append(button);
    element.prepend(list);
    plot.on_event("mousemove", ({ x }) => {
      time.textContent = `t = ${shown(x)} s`;
      for (const [value, curve, told] of entries)
        if (curve) value.textContent = told(curve(), curves.nearest(curve().x, x));
    });
    plot.on_event("mouseleave", () => {
      time.textContent = "";
      for (const [value] of entries) value.textContent = "";
    });
    return button;
  }

  function switcher(one) {
    const button = make("button", "difference", "Difference");
    Object.assign(button, {
      type: "button",
      ariaPressed: "false",
      title: `Show all as differences from the ${one.data.base}`,
    });
    button.addEventListener("click", () => {
      const wanted = button.ariaPressed !== "true";
      button.ariaPressed = String(wanted);
      show(one, wanted ? curves.difference(one.given) : one.given);
    });
    return button;
  }

  const eyes = new IntersectionObserver(
    (seen) => {
      for (const { isIntersecting, target } of seen)
        if (isIntersecting) {
          eyes.unobserve(target);
          draw(target);
        }
    },
    { rootMargin: "200px" },
  );
  document.body.append(probe);
  const waiting = [...document.querySelectorAll("[data-plot]")];
  for (const element of waiting) eyes.observe(element);

  // Draw the remaining plots when the browser is idle, because a printed page shows all.
  async function rest() {
    for (const element of waiting)
      if (!drawn.has(element) && element.checkVisibility()) {
        await new Promise((done) => (globalThis.requestIdleCallback ?? setTimeout)(done));
        await draw(element);
      }
  }
  function forget(element) {
    drawn.delete(element);
    element.remove();
  }
  document.addEventListener("theme", () => {
    for (const one of drawn.values()) if (one) paint(one);
  });
  for (const button of document.querySelectorAll(".signal button[aria-controls]"))
    button.addEventListener("click", () => {
      const row = document.getElementById(button.getAttribute("aria-controls"));
      row.hidden = !row.hidden;
      button.ariaExpanded = String(!row.hidden);
    });
  return { draw, rest, forget };
})();

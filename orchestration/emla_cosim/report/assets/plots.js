// Draws each plot when it comes into view: figures are Bokeh's, made in drawing.py, filled with data here.
"use strict";
const drawn = new Map(); // figure elements and what is drawn in them

(() => {
  const parsed = (id) => JSON.parse(document.getElementById(id).textContent);
  const numbers = (values) => Float64Array.from(values, (v) => (v === null ? NaN : v));
  const shown = (v) => (Number.isFinite(v) ? String(Number(v.toPrecision(6))) : "–");
  const make = (tag, className, text) => Object.assign(document.createElement(tag), { className, textContent: text ?? "" });

  const probe = make("i", "probe");
  const color = (name) => { // as the page has it now
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

  async function draw(element) {
    if (drawn.has(element)) return;
    drawn.set(element, null);
    const data = parsed(`${element.dataset.plot}-data`);
    const canvas = make("div", "canvas");
    element.replaceChildren(canvas);
    const views = await withBokeh().embed.embed_item(parsed(`figure-${data.shape}`), canvas);
    const plot = views.roots[0].model;
    const model = (name) => plot.document.get_model_by_name(name);
    data.lines.forEach((line, k) => fill(model(`line-${k}-data`), { x: numbers(line.x), y: numbers(line.y) }));
    if (data.band) fill(model("band-data"), { x: numbers(data.band.x), lower: numbers(data.band.lower), upper: numbers(data.band.upper) });
    if (data.mark) fill(model("mark-data"), { x: [data.mark[0]], y: [data.mark[1]] });
    plot.left[0].axis_label = data.unit;
    const one = { element, plot, data, model };
    drawn.set(element, one);
    paint(one);
    show(one, data.x, data.y);
    legend(one);
    plot.on_event("doubletap", () => show(one, data.x, data.y));
    element.addEventListener("keydown", (event) => keys(one, event));
    element.dataset.drawn = "yes";
  }

  function fill(source, data) { source.data = data; }

  function show({ plot }, x, y) { // and come back here on reset
    for (const [range, [start, end]] of [[plot.x_range, x], [plot.y_range, y]]) range.setv({ start, end, reset_start: start, reset_end: end });
  }

  function keys({ plot, data }, event) {
    const range = plot.x_range, width = range.end - range.start, middle = (range.start + range.end) / 2;
    const to = { "+": [middle - width / 4, middle + width / 4], "-": [middle - width, middle + width],
                 ArrowLeft: [range.start - width / 8, range.end - width / 8], ArrowRight: [range.start + width / 8, range.end + width / 8] }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "0") { range.setv({ start: data.x[0], end: data.x[1] }); plot.y_range.setv({ start: data.y[0], end: data.y[1] }); }
    else if (to) range.setv({ start: to[0], end: to[1] });
    else return;
    event.preventDefault();
  }

  function paint({ plot, data, model }) {
    const ink = color("soft"), line = color("line"), font = getComputedStyle(document.body).fontFamily;
    for (const axis of [...plot.below, ...plot.left]) axis.setv({ axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: line,
      major_tick_line_color: line, axis_label_text_font: font, major_label_text_font: font, axis_label_text_font_size: "12px", major_label_text_font_size: "11px" });
    for (const grid of plot.center) if (grid.dimension === 1) grid.grid_line_color = line;
    data.lines.forEach((curve, k) => model(`line-${k}`).glyph.setv({ line_color: color(curve.color), line_dash: curve.dashed ? [5, 3] : [] }));
    if (data.band) {
      model("band").glyph.setv({ fill_color: color("band"), fill_alpha: 1 });
      for (const edge of ["lower", "upper"]) model(`band-${edge}`).glyph.line_color = color("band-edge");
    }
    model("mark").glyph.line_color = color("red");
    model("crosshair").line_color = ink;
  }

  // Says what is what, and what it is where the mouse points.
  function legend({ element, plot, data }) {
    const list = make("figcaption", "legend"), entries = [];
    const entry = (label, className, curve, told) => {
      const item = make("span", "entry"), swatch = make("i", `swatch ${className}`), value = make("output", "value");
      item.append(swatch, make("bdi", "", label), value);
      list.append(item);
      entries.push([value, curve, told]);
      return swatch;
    };
    const time = make("span", "entry at");
    for (const line of data.lines) {
      const swatch = entry(line.label, line.dashed ? "dashed" : "", line, (k) => shown(line.y[k] ?? NaN));
      swatch.style.setProperty("--swatch", `var(--${line.color})`);
    }
    if (data.band) entry(data.band.label, "filled", data.band, (k) => `${shown(data.band.lower[k] ?? NaN)} … ${shown(data.band.upper[k] ?? NaN)}`);
    if (data.mark) entry(`worst at ${shown(data.mark[0])} s`, "ring", null, null);
    list.append(time);
    element.prepend(list);
    plot.on_event("mousemove", ({ x }) => {
      time.textContent = `t = ${shown(x)} s`;
      for (const [value, curve, told] of entries) if (curve) value.textContent = told(nearest(curve.x, x));
    });
    plot.on_event("mouseleave", () => { time.textContent = ""; for (const [value] of entries) value.textContent = ""; });
  }

  function nearest(times, x) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (times[middle] <= x) low = middle; else high = middle; }
    return x - times[low] <= times[high] - x ? low : high;
  }

  const eyes = new IntersectionObserver((seen) => { for (const { isIntersecting, target } of seen) if (isIntersecting) { eyes.unobserve(target); draw(target); } }, { rootMargin: "200px" });
  document.body.append(probe);
  for (const element of document.querySelectorAll("[data-plot]")) eyes.observe(element);
  document.addEventListener("theme", () => { for (const one of drawn.values()) if (one) paint(one); });
})();

// Draw each plot when it becomes visible, and the others later for printing. Plots of a subject show the same time.
"use strict";
(() => {
  const plots = [...document.querySelectorAll(".plot")],
    ranges = new Map();

  async function draw(element) {
    if (element.dataset.drawn) return;
    element.dataset.drawn = "begun";
    const content = JSON.parse(element.querySelector("script").textContent),
      views = await Bokeh.embed.embed_item(content, element);
    link(element.dataset.subject, views.roots[0].model.x_range);
    element.dataset.drawn = "yes";
    element.dispatchEvent(new Event("drawn", { bubbles: true }));
  }

  function link(subject, range) {
    const group = ranges.get(subject) ?? [range];
    ranges.set(subject, [...group, range]);
    range.setv({ start: group[0].start, end: group[0].end });
    range.change.connect(() => {
      for (const other of ranges.get(subject)) other.setv({ start: range.start, end: range.end });
    });
  }

  const observer = new IntersectionObserver((seen) => {
    for (const { isIntersecting, target } of seen) if (isIntersecting) draw(target);
  });
  for (const element of plots) observer.observe(element);
  addEventListener("load", async () => {
    for (const element of plots)
      if (element.checkVisibility()) {
        await draw(element);
        await new Promise((done) => (globalThis.requestIdleCallback ?? setTimeout)(done));
      }
  });
})();

// Search, filters, links and selected signals. "/" focuses the search field, Escape shows everything.
"use strict";
(() => {
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const field = document.querySelector("input[type=search]");
  if (!field) return;
  const entries = all("[data-entry]"),
    sections = all("[data-section]"),
    verdicts = all("button[data-verdict]"),
    status = document.querySelector(".shown"),
    nothing = document.querySelector(".nothing");
  const texts = new Map(),
    opened = new Map();

  function text(entry) {
    // its own text, and that of the head of its sections
    if (!texts.has(entry)) {
      const heads = sections.filter((s) => s.contains(entry)).flatMap((s) => all(":scope > summary, :scope > .facts", s));
      texts.set(entry, [entry, ...heads].map((e) => e.textContent).join(" ").toLowerCase());
    }
    return texts.get(entry);
  }

  function filter() {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean),
      pressed = verdicts.filter((b) => b.ariaPressed === "true").map((b) => b.dataset.verdict),
      isFiltered = words.length + pressed.length > 0;
    for (const entry of entries)
      entry.hidden =
        !words.every((word) => text(entry).includes(word)) ||
        (pressed.length > 0 && !pressed.includes(entry.dataset.entry));
    for (const section of sections) {
      section.hidden = isFiltered && !section.querySelector("[data-entry]:not([hidden])");
      if (isFiltered && !opened.has(section)) opened.set(section, section.open);
      section.open = isFiltered || (opened.get(section) ?? section.open);
      for (const row of all(`[data-about="${section.id}"]`)) row.hidden = section.hidden;
    }
    if (!isFiltered) opened.clear();
    const shown = entries.filter((entry) => !entry.hidden).length;
    status.textContent = isFiltered ? `${shown} of ${entries.length} ${status.dataset.entries}` : "";
    nothing.hidden = shown > 0 || !isFiltered;
  }

  function reset() {
    field.value = "";
    for (const button of verdicts) button.ariaPressed = "false";
    filter();
  }

  function follow() {
    // open the target of a link, and show it even if it is filtered out
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    if (target.closest("[hidden]")) reset();
    for (let details = target.closest("details"); details; details = details.parentElement.closest("details"))
      details.open = true;
    target.scrollIntoView();
  }

  function select() {
    // show the curves of the selected signals and their entries of legends, and the plots that have any
    for (const box of all("input[data-signal]"))
      for (const item of Bokeh.documents.map((drawn) => drawn.get_model_by_name(box.dataset.signal)))
        for (const model of item ? [item, ...item.renderers] : []) model.visible = box.checked;
    for (const plot of all("[data-signals]"))
      plot.hidden = !document.querySelector(`input[data-plot="${plot.dataset.signals}"]:checked`);
  }

  field.addEventListener("input", filter);
  for (const button of verdicts)
    button.addEventListener("click", () => {
      button.ariaPressed = String(button.ariaPressed !== "true");
      filter();
    });
  nothing.querySelector("button").addEventListener("click", reset);
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && document.activeElement !== field) {
      event.preventDefault();
      field.focus();
    } else if (event.key === "Escape") reset();
  });
  document.addEventListener("change", (event) => event.target.matches("[data-signal]") && select());
  document.addEventListener("drawn", (event) => event.target.closest("[data-signals]") && select());
  addEventListener("hashchange", follow);
  follow();
})();

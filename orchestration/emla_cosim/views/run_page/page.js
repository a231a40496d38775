// Search signals by parts of their names, and plot the selected ones. Signals with the same unit share a plot.
"use strict";
(() => {
  const section = document.querySelector("#signals");
  const colors = ["blue", "orange", "green", "red", "purple", "grey"];
  if (section) choose();
  addEventListener("load", () => plots.rest());

  function choose() {
    const search = section.querySelector("input"),
      status = section.querySelector(".shown"),
      none = section.querySelector(".nothing"),
      clear = section.querySelector(".clear"),
      place = section.querySelector(".chosen"),
      hint = place.querySelector("p");
    const rows = [...section.querySelectorAll("[data-signal]")].map((element) => ({
      element,
      button: element.querySelector("button"),
      text: element.textContent.toLowerCase(),
      index: Number(element.dataset.signal),
    }));
    const curves = JSON.parse(document.getElementById("signals-data").textContent);
    const chosen = new Map(); // plots with their signals
    let turn = Promise.resolve(); // one at a time: a plot must not be removed while it is drawn

    function filter() {
      const words = sought();
      let shown = 0;
      for (const { element, text } of rows) {
        element.hidden = !words.every((w) => text.includes(w));
        shown += !element.hidden;
      }
      status.textContent = words.length ? `${shown} of ${rows.length} signals` : "";
      none.hidden = shown > 0;
    }

    function toggle({ button, index }) {
      if (!curves[index]) return;
      const on = button.ariaPressed !== "true";
      button.ariaPressed = String(on);
      turn = turn.then(() => change(on, index));
    }

    async function change(on, index) {
      const { unit } = curves[index];
      const [before, members] = [...chosen].find(
        ([, c]) => c.unit === unit && (on ? c.signals.length < colors.length : c.signals.includes(index)),
      ) ?? [null, { unit, signals: [] }];
      const signals = on ? [...members.signals, index] : members.signals.filter((s) => s !== index);
      const element = signals.length ? make(unit) : null;
      if (element && before) before.replaceWith(element);
      else if (element) place.append(element);
      if (before) {
        chosen.delete(before);
        plots.forget(before);
      }
      if (element) {
        chosen.set(element, { unit, signals });
        await plots.draw(element, plot(unit, signals));
      }
      hint.hidden = chosen.size > 0;
      clear.hidden = !hint.hidden;
    }

    function make(unit) {
      const element = document.createElement("figure");
      element.className = "plot";
      element.tabIndex = 0;
      element.ariaLabel = `Selected signals in ${unit || "no unit"}: plot; plus and minus zoom, arrows move, 0 resets`;
      return element;
    }

    function plot(unit, signals) {
      const lines = signals.map((s, k) => ({ ...curves[s], color: colors[k], dashed: false }));
      const ends = (axis, room) => {
        const low = Math.min(...lines.map((l) => l[axis].middle - l[axis].half)),
          high = Math.max(...lines.map((l) => l[axis].middle + l[axis].half));
        return [low - room * (high - low), high + room * (high - low)];
      };
      return {
        shape: `${lines.length}-0-0`,
        unit,
        x: ends("x", 0.01),
        y: ends("y", 0.05),
        lines,
        band: null,
        mark: null,
        since: null,
        base: null,
        limits: [],
        group: "chosen signals",
      };
    }

    const sought = searchable(search, filter, () => {
      search.value = "";
      filter();
    });
    for (const row of rows) row.button.addEventListener("click", () => toggle(row));
    clear.addEventListener("click", () => {
      for (const row of rows) if (row.button.ariaPressed === "true") toggle(row);
    });
  }
})();

// Search, filter by verdict, and links that open closed or hidden findings.
"use strict";
(() => {
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const search = document.querySelector(".filters input"),
    status = document.querySelector(".shown"),
    none = document.querySelector(".nothing");
  const buttons = all(".filters [data-verdict]");
  const fmus = all(".fmu").map((element) => ({
    element,
    open: element.open,
    row: document.querySelector(`[data-fmu="${element.id}"]`),
    groups: all(".group", element).map((group) => ({ element: group, findings: all(".finding", group) })),
  }));
  const texts = new Map();
  const text = (element) =>
    texts.get(element) ?? texts.set(element, element.textContent.toLowerCase()).get(element);

  function filter() {
    const words = sought();
    const verdicts = new Set(buttons.filter((b) => b.ariaPressed === "true").map((b) => b.dataset.verdict));
    const filtered = words.length > 0 || verdicts.size > 0;
    let shown = 0,
      total = 0;
    for (const fmu of fmus) {
      const about = text(fmu.element.querySelector("summary")) + text(fmu.element.querySelector(".facts"));
      let here = 0;
      for (const group of fmu.groups) {
        let some = 0;
        for (const finding of group.findings) {
          const fits =
            (!verdicts.size || verdicts.has(finding.dataset.verdict)) &&
            words.every((w) => about.includes(w) || text(finding).includes(w));
          finding.hidden = !fits;
          some += fits;
        }
        group.element.hidden = !some;
        here += some;
        total += group.findings.length;
      }
      fmu.element.hidden = !here;
      if (fmu.row) fmu.row.hidden = !here;
      fmu.element.open = filtered ? here > 0 : fmu.open;
      shown += here;
    }
    status.textContent = filtered ? `${shown} of ${total} checks` : "";
    none.hidden = shown > 0 || !filtered;
  }

  function reset() {
    search.value = "";
    for (const button of buttons) button.ariaPressed = "false";
    filter();
  }

  function follow() {
    // open and show the target of a link even if it is closed or filtered out
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    if (target.closest("[hidden]")) reset();
    for (let element = target; element; element = element.parentElement?.closest("details"))
      if (element.tagName === "DETAILS") element.open = true;
    target.closest("details").open = true;
    target.scrollIntoView();
  }

  const sought = searchable(search, filter, reset);
  for (const button of buttons)
    button.addEventListener("click", () => {
      button.ariaPressed = String(button.ariaPressed !== "true");
      filter();
    });
  none.querySelector("button").addEventListener("click", () => {
    reset();
    search.focus();
  });
  for (const fmu of fmus)
    fmu.element.querySelector("summary").addEventListener("click", () => {
      if (!status.textContent) fmu.open = !fmu.element.open;
    });
  addEventListener("hashchange", follow);
  document.addEventListener("click", (event) => {
    if (event.target.closest?.(`a[href="${location.hash}"]`)) setTimeout(follow);
  });
  if (location.hash) follow();
})();

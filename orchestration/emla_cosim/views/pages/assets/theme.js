// Light or dark theme: the system's until the user selects one; the browser stores the selection if allowed.
"use strict";
(() => {
  const root = document.documentElement,
    system = matchMedia("(prefers-color-scheme: dark)");
  const kept = {
    get: () => {
      try {
        return localStorage.getItem("theme");
      } catch {
        return null;
      }
    },
    set: (name) => {
      try {
        localStorage.setItem("theme", name);
      } catch {
        /* not stored */
      }
    },
  };
  const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  const told = () => {
    const button = document.querySelector(".theme");
    if (button) {
      button.hidden = false;
      button.textContent = dark() ? "Light" : "Dark";
      button.title = `Show the page ${dark() ? "light" : "dark"}`;
    }
    document.dispatchEvent(new Event("theme"));
  };
  const chosen = (name) => {
    if (name) root.dataset.theme = name;
    else delete root.dataset.theme;
    told();
  };
  if (["light", "dark"].includes(kept.get())) root.dataset.theme = kept.get();
  system.addEventListener("change", told);
  document.addEventListener("DOMContentLoaded", () => {
    told();
    document.querySelector(".theme").addEventListener("click", () => {
      const name = dark() ? "light" : "dark";
      kept.set(name);
      chosen(name);
    });
  });
  let before;
  addEventListener("beforeprint", () => {
    before = root.dataset.theme;
    chosen("light");
  }); // print in the light theme
  addEventListener("afterprint", () => chosen(before));
})();

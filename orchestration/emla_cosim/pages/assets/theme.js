// Light or dark theme: the system's until the user selects one; the browser stores the selection if allowed.
"use strict";
(() => {
  const root = document.documentElement,
    system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  try {
    const stored = localStorage.getItem("theme");
    if (["light", "dark"].includes(stored)) root.dataset.theme = stored;
  } catch {
    /* not allowed */
  }
  document.addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector(".theme");
    const label = () => (button.textContent = isDark() ? "Light" : "Dark");
    button.hidden = false;
    button.title = "Show the page in the other theme";
    button.addEventListener("click", () => {
      root.dataset.theme = isDark() ? "light" : "dark";
      label();
      try {
        localStorage.setItem("theme", root.dataset.theme);
      } catch {
        /* not allowed */
      }
    });
    system.addEventListener("change", label);
    label();
  });
})();

// A search field: "/" leads to it, Escape empties it. Returns what gives the words in it.
"use strict";
const searchable = (field, filter, reset) => {
  field.addEventListener("input", filter);
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && document.activeElement !== field) {
      event.preventDefault();
      field.focus();
    }
    if (event.key === "Escape" && document.activeElement === field) reset();
  });
  return () => field.value.toLowerCase().split(/\s+/).filter(Boolean);
};

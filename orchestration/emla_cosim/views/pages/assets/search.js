// Set up a search field: "/" focuses it, Escape clears it. Return a function that reads its words.
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

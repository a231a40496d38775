"""The colors of all figures and pages."""

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#2f6db3", "#d9822b", "#3d8f5f", "#b0413e", "#7b5ea7", "#7a7a7a"
COLORS = BLUE, ORANGE, GREEN, RED, PURPLE, GREY

"""The colours of all pictures and pages."""

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#2f6db3", "#d9822b", "#3d8f5f", "#b0413e", "#7b5ea7", "#7a7a7a"
NAMES = {BLUE: "blue", ORANGE: "orange", GREEN: "green", RED: "red", PURPLE: "purple", GREY: "grey"}
"""What pages call them, which have other ones for dark grounds."""

COLORS: tuple[str, ...] = tuple(NAMES)

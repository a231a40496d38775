"""File formats of plots."""

PLOT_FORMATS = {
    "png": "pixels, 150 per inch",
    "pdf": "vectors, for papers",
    "svg": "vectors, for web pages and drawing programs",
}
"""Descriptions by the ending of file names."""

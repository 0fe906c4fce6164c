"""HTML pages and pictures: one frame, one stylesheet, one script for plots, and a template for each kind of page."""

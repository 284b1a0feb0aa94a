"""Drawings in DXF, SVG and CSV, traced at the fastest speed within the limits of the axes."""

from gantrysim.controllers.drawings.drawing import Drawing

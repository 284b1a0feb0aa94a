"""The bead: how the glue lies along the nozzle's trace, and on a height map that conserves volume."""

from gantrysim.bead.bead import Bead, BeadValues
from gantrysim.bead.height_map import HeightMap
from gantrysim.bead.section import Section
from gantrysim.bead.trace import BeadSettings

"""The bead: how the glue lies along the nozzle's trace, and on a height map that conserves volume."""

from gantrysim.glue.bead.bead import Bead
from gantrysim.glue.bead.height_map import HeightMap
from gantrysim.glue.bead.ploughing import Ploughing
from gantrysim.glue.bead.section import BeadSettings, Section
from gantrysim.glue.bead.values import BeadValues

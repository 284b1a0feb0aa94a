"""The bead: how the glue lies along the nozzle's trace, and on a height map that conserves volume."""

from gantrysim.bead.bead import Bead
from gantrysim.bead.height_map import HeightMap
from gantrysim.bead.ploughing import Ploughing
from gantrysim.bead.section import Section
from gantrysim.bead.settings import BeadSettings
from gantrysim.bead.values import BeadValues

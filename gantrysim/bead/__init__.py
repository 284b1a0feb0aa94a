"""The bead: how the glue lies along the nozzle's trace, and on a height map that conserves volume."""

from gantrysim.bead.bead import Bead, BeadFigures
from gantrysim.bead.deposit import HeightMap
from gantrysim.bead.section import Section
from gantrysim.bead.strand import BeadSettings

__all__ = ["Bead", "BeadFigures", "BeadSettings", "HeightMap", "Section"]

"""softMC's CIRCLE: the motion language MC-Basic of Servotronix' softMC controllers."""

from gantrysim.controllers.softmc.commands import Circle, Move
from gantrysim.controllers.softmc.errors import SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.program import Program
from gantrysim.controllers.softmc.record import Record

"""The CIRCLE command of MC-Basic, the motion language of Servotronix' softMC controllers."""

from gantrysim.controllers.softmc.commands import Circle, Move, SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.program import Program
from gantrysim.controllers.softmc.record import Record

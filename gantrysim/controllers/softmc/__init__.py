"""MC-Basic, the language of Servotronix' softMC controllers: its CIRCLE and MOVE commands, and whole programs."""

from gantrysim.controllers.softmc.basic import Basic
from gantrysim.controllers.softmc.basic.recording import Record
from gantrysim.controllers.softmc.commands import Circle, Move, SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.program import Program

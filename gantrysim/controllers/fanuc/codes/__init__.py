"""The codes of a program of blocks, each a function of its name."""

from gantrysim.controllers.fanuc.codes import coordinates, modes, motion
from gantrysim.controllers.fanuc.codes.code import ACTIONS, AUXILIARY, MOTIONS, SETTINGS, g_codes
from gantrysim.controllers.fanuc.codes.motion import CENTRES

"""The codes of a program of blocks, each a function of its name."""

from gantrysim.controllers.fanuc.codes import interpolation, modal_codes, zero_points
from gantrysim.controllers.fanuc.codes.handlers import ACTIONS, MOTIONS, SETTINGS, g_codes, g_codes_in_short
from gantrysim.controllers.fanuc.codes.interpolation import CENTRES

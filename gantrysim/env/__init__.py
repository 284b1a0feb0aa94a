"""Gymnasium environments: gains, or the pressure of the dispenser or the speed, set while the nozzle follows a path."""

from gantrysim.env.bead_width import BeadWidthEnv, BeadWidthSettings, BeadWidthVectorEnv
from gantrysim.env.scalar import GainBanditEnv, SpiralTuningEnv
from gantrysim.env.settings import Settings
from gantrysim.env.speed_override import SpeedOverrideEnv, SpeedOverrideSettings, SpeedOverrideVectorEnv
from gantrysim.env.vector import GainBanditVectorEnv, SpiralTuningVectorEnv

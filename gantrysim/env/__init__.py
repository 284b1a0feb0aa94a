"""Gymnasium environments: gains, or the pressure of the dispenser or the speed, set while the nozzle follows a path."""

from gantrysim.env.baselines import slow_at_reversals, width_feedback
from gantrysim.env.bead_width import BeadWidthEnv, BeadWidthSettings, BeadWidthVectorEnv
from gantrysim.env.scalar import GainBanditEnv, SpiralTuningEnv
from gantrysim.env.settings import Settings
from gantrysim.env.speed_override import SpeedOverrideEnv, SpeedOverrideVectorEnv
from gantrysim.env.timeline import SpeedOverrideSettings
from gantrysim.env.vector import GainBanditVectorEnv, SpiralTuningVectorEnv

"""Gymnasium environments in which an agent tunes the servo: gantrysim/SpiralTuning-v0 and gantrysim/GainBandit-v0."""

from gantrysim.env.scalar import GainBanditEnv, SpiralTuningEnv
from gantrysim.env.settings import Settings
from gantrysim.env.vector import GainBanditVectorEnv, SpiralTuningVectorEnv

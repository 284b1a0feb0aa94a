"""Gymnasium environments in which an agent tunes the servo: gantrysim/SpiralTuning-v0 and gantrysim/GainBandit-v0."""

import gymnasium

from gantrysim.env.scalar import GainBanditEnv, SpiralTuningEnv
from gantrysim.env.settings import Settings
from gantrysim.env.vector import GainBanditVectorEnv, SpiralTuningVectorEnv

__all__ = ["GainBanditEnv", "GainBanditVectorEnv", "Settings", "SpiralTuningEnv", "SpiralTuningVectorEnv"]

for _name in ("SpiralTuning", "GainBandit"):
    gymnasium.register(
        f"gantrysim/{_name}-v0",
        entry_point=f"gantrysim.env:{_name}Env",
        vector_entry_point=f"gantrysim.env:{_name}VectorEnv",
    )

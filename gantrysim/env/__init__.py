"""Gymnasium environments: gains, torques, pressure or speed set while the nozzle follows a path."""

from gantrysim.env.baselines import friction_compensation, gain_schedule, slow_at_reversals, width_feedback
from gantrysim.env.bead_width import BeadWidthEnv, BeadWidthSettings, BeadWidthVectorEnv
from gantrysim.env.gain_bandit import GainBanditEnv, GainBanditVectorEnv
from gantrysim.env.servo_torque import ServoTorqueEnv, ServoTorqueSettings, ServoTorqueVectorEnv
from gantrysim.env.settings import Settings
from gantrysim.env.speed_override import SpeedOverrideEnv, SpeedOverrideVectorEnv
from gantrysim.env.spiral_tuning import SpiralTuningEnv, SpiralTuningSettings, SpiralTuningVectorEnv
from gantrysim.env.timeline import SpeedOverrideSettings

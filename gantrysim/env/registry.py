"""The environments that gantrysim registers with Gymnasium."""

# Identity in Gymnasium's registry, after "gantrysim/", and the module of env/ that holds the task: of "Thing-v0" the
# classes ThingEnv and ThingVectorEnv.
TASKS = {
    "SpiralTuning-v0": "spiral_tuning",
    "GainBandit-v0": "gain_bandit",
    "BeadWidth-v1": "bead_width",
    "SpeedOverride-v1": "speed_override",
    "ServoTorque-v1": "servo_torque",
}

"""Motion controllers and the servo: programs in, setpoints and torques out. Nothing here knows MuJoCo."""

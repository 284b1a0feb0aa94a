"""Motion controllers and the servo: programs in, setpoints and torques out. This package is independent of MuJoCo."""

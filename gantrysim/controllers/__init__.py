"""Motion controllers and their languages: programs in, setpoints out. This package is independent of MuJoCo."""

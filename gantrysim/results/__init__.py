"""Whether a run is good enough: tolerances and their defaults, and the verdict on the run."""

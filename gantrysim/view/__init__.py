"""MuJoCo's interactive viewer, with a saved run that plays or a job that runs live, and the bead that grows."""

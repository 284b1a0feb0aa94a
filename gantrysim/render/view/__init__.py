"""MuJoCo's interactive viewer for a saved run that is replayed or a job that runs live, with the growing bead."""

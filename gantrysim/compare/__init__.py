"""A measured trace beside its simulation, aligned and compared link by link."""

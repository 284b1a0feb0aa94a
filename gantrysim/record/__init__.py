"""What a run is made of and what it leaves: setpoints, the record of a run and its file."""

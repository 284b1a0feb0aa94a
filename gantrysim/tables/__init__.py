"""Tables that other programs write, read as columns: text of any dialect, Parquet, MATLAB, MCAP, controllers' logs."""

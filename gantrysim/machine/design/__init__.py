"""A machine from a table: motors, transmissions, guides and masses in a TOML file become a complete MJCF."""

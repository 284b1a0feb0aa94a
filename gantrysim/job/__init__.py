"""Jobs: one file that describes a run completely, and overrides of its values."""

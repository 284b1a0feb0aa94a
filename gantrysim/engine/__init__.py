"""The engine: runs of setpoints, servo and machine at native speed, one at a time or many."""

"""What to change in a job that is not good enough: levers, each simulated alone, and their best combination."""

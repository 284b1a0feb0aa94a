"""The ladder of servo laws beyond PID: each one small function with its equation, chosen by name."""

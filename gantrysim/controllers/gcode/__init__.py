"""G-code: a reader, an interpreter and a planner with look-ahead, which dialects share."""

"""The core of BASIC dialects: operators, statements, blocks and jumps, frames, tasks and their clock."""

"""Errors, arrays, files, tables and compiled functions: what every room needs and no subject owns."""

"""The core of the macro languages of G-code: expressions, parameters, calls and loops; each dialect gives its words."""

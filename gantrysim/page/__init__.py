"""Reports: one HTML file that holds all it shows, for a browser without a network."""

from gantrysim.page.document import Column, Section, Table, write_page

__all__ = ["Column", "Section", "Table", "write_page"]

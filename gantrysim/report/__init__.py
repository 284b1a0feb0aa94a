"""Reports: one HTML file that holds all it shows, for a browser without a network."""

from gantrysim.report.document import Column, Section, Table, write_page

"""Reports and output folders: summary.json, the HTML report of a run, and the page on which studies report too."""

from gantrysim.report.document import Column, Section, Table
from gantrysim.report.drawn_page import write_page

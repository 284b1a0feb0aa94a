"""The study of laws: what each law of the servo gains over PD."""

from gantrysim.study.laws.study import LADDER, LawsStudy, laws_row, reversals

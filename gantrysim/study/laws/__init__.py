"""The laws study: the gain of each of the servo's laws over PD."""

from gantrysim.study.laws.study import LADDER, LawsStudy, laws_row, reversals

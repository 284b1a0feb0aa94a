"""Accuracy classes of ball screws."""

# band of the travel within 300 mm and within a turn [um]: C* of JIS B 1192, P* and T* of ISO 3408-3, as catalogues
# print them; grades 7 and 10 have no band within a turn: 12 and 30 are assumptions
SCREWS = {
    "C0": (3.5, 3.0),
    "C1": (5.0, 4.0),
    "C2": (7.0, 5.0),
    "C3": (8.0, 6.0),
    "C5": (18.0, 8.0),
    "C7": (50.0, 12.0),
    "C10": (210.0, 30.0),
    "P0": (3.5, 3.0),
    "P1": (6.0, 4.0),
    "P3": (12.0, 6.0),
    "P5": (23.0, 8.0),
    "P7": (52.0, 12.0),
    "T3": (12.0, 6.0),
    "T5": (23.0, 8.0),
    "T7": (52.0, 12.0),
    "T10": (210.0, 30.0),
}

"""Short jobs for the viewer of their pages: with a corner, an arc, a stop and a loop; and one that climbs."""

from gantrysim import Job

TEXT = """G21 G17 G90 G64 P0.02
F6000
G0 X5 Y0
M62 P0
G1 X30
G3 X40 Y10 J10
G1 Y20 (a < b)
M63 P0
G0 X5
M62 P0
G1 X20
M63 P0
G0 X0 Y0
M2
"""

CLIMB = """G21 G17 G90 G64 P0.02
F2400
G0 X20 Y0 Z0
M62 P0
G3 X-20 Y0 I-20 Z8
G3 X14 Y0 I17 Z16
M63 P0
G0 Z24
M2
"""


def viewer_job():
    return Job(
        name="short",
        machine="xy",
        program={
            "controller": "linuxcnc.Program",
            "text": TEXT,
            "dispense": {"by": "codes", "on": ["M62"], "off": ["M63"]},
        },
        dispenser={"flow": 100.0},
    )


def climbing_job():
    """Two half circles, 16 mm up."""
    return Job(
        name="climb",
        machine="xyz",
        program={
            "controller": "linuxcnc.Program",
            "text": CLIMB,
            "dispense": {"by": "codes", "on": ["M62"], "off": ["M63"]},
        },
        dispenser={"flow": 40.0},
    )

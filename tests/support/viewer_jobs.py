"""A short job for the viewer of its page, with a program, a corner, an arc, a stop of the glue, and a loop."""

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

"""A job and a program that the tests of the workbench open: each moves and lays glue for part of a second."""

TEXT = """G21 G90 G64 P0.02
F6000
G0 X5 Y0
M62 P0
G1 X30
G1 Y20
M63 P0
M2
"""
JOB = """name = "short"
machine = "xy"
[program]
controller = "trio.MoveSpiral"
diameter = 30.0
turns = 1
thickness = 5.0
speed = 100.0
loop_period = 0.02
acceleration = 2000.0
[dispenser]
flow = 200.0
"""

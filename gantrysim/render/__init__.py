"""Offscreen pictures and films of a run, from its record: the machine and the bead growing behind the nozzle."""

from gantrysim.render.film import Film, Take, save_video
from gantrysim.render.opengl import NoOpenGLError
from gantrysim.render.renderer import Renderer

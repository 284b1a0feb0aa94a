"""Offscreen pictures and films of a run, from its record: the machine and the bead growing behind the nozzle."""

from gantrysim.render.film import Film, Take
from gantrysim.render.opengl import NoOpenGLError
from gantrysim.render.renderer import Renderer
from gantrysim.render.video import save_video

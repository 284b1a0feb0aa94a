"""The loop study: what the periods and resolutions of the chain do to the bead."""

from gantrysim.study.loop.arcs import SteppedArcs
from gantrysim.study.loop.study import LoopStudy
from gantrysim.study.loop.variants import AS_IT_IS, FREE, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT, SWEEPS

"""The loop study: the effect of the periods and resolutions of the chain on the bead."""

from gantrysim.study.loop.study import AS_IT_IS, LOOP_ALONE, NO_FRICTION, NO_LOOP, PERFECT, SWEEPS, LoopStudy

"""Gymnasium's specification of an environment, with the largest number of decisions in an episode."""

from __future__ import annotations

from dataclasses import replace

from gymnasium.envs.registration import EnvSpec

from gantrysim.job.job import Job


def with_bound(spec: EnvSpec, longest: int) -> EnvSpec:
    """Return a specification with the largest number of decisions in an episode, and a job as JSON can hold it."""
    job = spec.kwargs.get("job")
    kwargs = {**spec.kwargs, "job": job.model_dump(exclude_none=True)} if isinstance(job, Job) else spec.kwargs
    return replace(spec, max_episode_steps=spec.max_episode_steps or longest, kwargs=kwargs)

"""Studies: many runs of a job, their findings, and a report."""

from gantrysim.base.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

from .study import TuningStudy as TuningStudy

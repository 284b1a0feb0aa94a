"""Reports and output folders: summary.json, the HTML report of a run, and the page on which studies report too."""

from gantrysim.base.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

"""Reports and output folders: summary.json, the HTML report of a run, and the page on which studies report too."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

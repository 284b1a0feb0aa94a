"""Simulate a glue-dispensing gantry; locate the bead's error on the chain from program to nozzle, find its causes."""

import sys

# the script, or the module after -m, of this process
if "".join(sys.orig_argv[-len(sys.argv) :][:1]).rpartition("/")[2] == "gantrysim":
    # an interrupt ends the command at once until it has its own handlers, instead of the traceback of an import
    import signal

    signal.signal(signal.SIGINT, signal.SIG_DFL)

from gantrysim.base.lazy_names import lazy_names

__version__ = "0.1.0"

# __init__.pyi lists the public names; each is imported at its first use
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

from . import plots as plots
from .document import Column as Column
from .document import Section as Section
from .document import Table as Table
from .drawn_page import write_page as write_page

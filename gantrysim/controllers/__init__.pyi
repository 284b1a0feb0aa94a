from . import fanuc as fanuc
from . import gcode as gcode
from . import softmc as softmc
from . import stage as stage
from . import trio as trio

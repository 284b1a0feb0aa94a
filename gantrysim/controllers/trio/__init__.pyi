from .basic import Basic as Basic
from .basic import InterpreterTime as InterpreterTime
from .basic import StatedSpiral as StatedSpiral
from .spiral import MoveSpiral as MoveSpiral

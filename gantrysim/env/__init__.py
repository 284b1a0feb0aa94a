"""Gymnasium environments: gains, torques, pressure or speed set while the nozzle follows a path.

Its import registers them, as does Gymnasium's "gantrysim.env:gantrysim/BeadWidth-v1".
"""

from gantrysim.base.extras import extra
from gantrysim.base.lazy_names import lazy_names
from gantrysim.env.registry import TASKS

with extra("learning", "gantrysim.env"):
    import gymnasium

# __init__.pyi lists the public names; each is imported at its first use
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

for _id, _module in TASKS.items():
    _name = _id.partition("-")[0]
    gymnasium.register(
        f"gantrysim/{_id}",
        entry_point=f"gantrysim.env.{_module}:{_name}Env",
        vector_entry_point=f"gantrysim.env.{_module}:{_name}VectorEnv",
    )

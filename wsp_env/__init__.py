"""A laboratory for railway wheel slide protection: degraded adhesion, Gymnasium environments, recorded stops.

Importing the package registers `wsp_env/Wheelset-v1`, `wsp_env/Bogie-v1` and `wsp_env/Coach-v1`.
"""

from wsp_env import envs

__all__ = ["envs"]
__version__ = "0.1.0"

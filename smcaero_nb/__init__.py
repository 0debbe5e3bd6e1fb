from . import lv, pid, smc1, smc2, surface
from .core import *

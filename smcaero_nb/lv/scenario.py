"""The launch vehicle's loops: laws and presets, with their sources."""

from ..core import ClosedLoop, ParameterError
from ..pid import pd, pid
from ..smc1 import quasi_smc
from ..smc2 import adaptive_super_twisting
from ..surface import itae, polynomial
from .plant import gimbal_to_control, launcher, misalignment, pitch, pitch_and_acceleration, steps

__all__ = ["PRESETS", "loop", "transfer_function"]

_r2 = dict(output=pitch, allocation=gimbal_to_control)
_rigid = gimbal_to_control.with_(G0=-0.75)
_eq69 = polynomial((1.75, 1.56))
_pd = dict(_r2, law=pd.with_(k_p=1.87, k_d=2.13))
_stw = adaptive_super_twisting.with_

#: {law: {preset: stages}}. `paper`: as printed; `recommended`: the best found on this scenario; the rest by surface.
PRESETS = {
    "pd": {"paper": _pd, "recommended": _pd},
    "pid": {"recommended": dict(_r2, law=pid.with_(k_p=1.87, k_i=0.6, k_d=2.13))},
    "quasi_smc": {
        "paper": dict(_r2, surface=_eq69, law=quasi_smc.with_(rho=0.45, eps=0.1)),
        "eq69": dict(_r2, surface=_eq69, law=quasi_smc.with_(rho=2.5, eps=0.45)),
        "recommended": dict(_r2, surface=itae(2, 10.0), law=quasi_smc.with_(rho=2.0, eps=0.25)),
        "r3": dict(output=pitch_and_acceleration, allocation=gimbal_to_control, surface=itae(3, 10.0/1.5), law=quasi_smc.with_(rho=1.4, eps=0.45)),
    },
    "adaptive_super_twisting": {
        "eq69": dict(_r2, allocation=_rigid, surface=_eq69, law=_stw(gamma=0.02, mu=0.1, lam_min=0.2, eps=0.005, eta=0.05, lam=1.25)),
        "recommended": dict(_r2, allocation=_rigid, surface=itae(2, 10.0/0.55),
                            law=_stw(gamma=0.07, mu=0.02, lam_min=0.25, eps=0.075, eta=0.03, lam=1.0)),
        "r3": dict(output=pitch_and_acceleration, allocation=gimbal_to_control.with_(G0=-3.75), surface=itae(3, 10.0/1.4),
                   law=_stw(gamma=0.01, mu=0.04, lam_min=0.8, eps=0.12, eta=0.03, lam=2.3)),
    },
}
for _law in ("quasi_smc", "adaptive_super_twisting"):
    PRESETS[_law]["itae2"] = PRESETS[_law]["recommended"]


def loop(law="adaptive_super_twisting", preset="recommended"):
    return ClosedLoop(launcher, reference=steps, perturbation=misalignment, duration=30.0, dt=1e-4, name=law, **PRESETS[law][preset])


def transfer_function():
    pass

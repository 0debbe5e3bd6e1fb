"""The literature that the cards of the blocks name."""

from .core.card import Source

__all__ = []

KODE = Source("S. Kode, Y. B. Shtessel, A. Levant, J. Rakoczy, M. Hannan and J. Orr", None,
              "Aerospace Sliding Mode Control Toolbox: Relative Degree Approach with Resource "
              "Prospector Lander and Launch Vehicle Case Studies", "Preprint")
ASTROM_1995 = Source("K. J. Astrom and T. Hagglund", 1995,
                     "PID Controllers: Theory, Design, and Tuning", "ISA")
BHAT_2005 = Source("S. P. Bhat and D. S. Bernstein", 2005,
                   "Geometric homogeneity with applications to finite-time stability",
                   "Mathematics of Control, Signals and Systems 17, 101-127")
BOIKO_2005 = Source("I. Boiko and L. Fridman", 2005,
                    "Analysis of chattering in continuous sliding-mode controllers",
                    "IEEE Transactions on Automatic Control 50, 1442-1446")
BURTON_1986 = Source("J. A. Burton and A. S. I. Zinober", 1986,
                     "Continuous approximation of variable structure control",
                     "International Journal of Systems Science 17, 875-885")
DING_2016 = Source("S. Ding, A. Levant and S. Li", 2016,
                   "Simple homogeneous sliding-mode controller", "Automatica 67, 22-32")
EDWARDS_1998 = Source("C. Edwards and S. K. Spurgeon", 1998,
                      "Sliding Mode Control: Theory and Applications", "Taylor and Francis")
EDWARDS_2014 = Source("C. Edwards and Y. Shtessel", 2014,
                      "Dual-layer adaptive sliding mode control",
                      "American Control Conference")
EDWARDS_2016 = Source("C. Edwards and Y. B. Shtessel", 2016,
                      "Adaptive continuous higher order sliding mode control",
                      "Automatica 65, 183-190")
GRAHAM_1953 = Source("D. Graham and R. C. Lathrop", 1953,
                     "The synthesis of optimum transient response: criteria and standard forms",
                     "Transactions of the AIEE 72, 273-288")
GUTMAN_1979 = Source("S. Gutman", 1979,
                     "Uncertain dynamical systems: a Lyapunov min-max approach",
                     "IEEE Transactions on Automatic Control 24, 437-443")
HUANG_2008 = Source("Y.-J. Huang, T.-C. Kuo and S.-H. Chang", 2008,
                    "Adaptive sliding-mode control for nonlinear systems with uncertain parameters",
                    "IEEE Transactions on Systems, Man, and Cybernetics, Part B 38, 534-539")
ISIDORI_1995 = Source("A. Isidori", 1995, "Nonlinear Control Systems", "Springer")
KOCH_2020 = Source("S. Koch, M. Reichhartinger, M. Horn and L. Fridman", 2020,
                   "Discrete-time implementation of homogeneous differentiators",
                   "IEEE Transactions on Automatic Control 65, 757-762")
LEVANT_1993 = Source("A. Levant", 1993,
                     "Sliding order and sliding accuracy in sliding mode control",
                     "International Journal of Control 58, 1247-1263")
LEVANT_2003 = Source("A. Levant", 2003,
                     "Higher-order sliding modes, differentiation and output-feedback control",
                     "International Journal of Control 76, 924-941")
LEVANT_2005 = Source("A. Levant", 2005,
                     "Quasi-continuous high-order sliding-mode controllers",
                     "IEEE Transactions on Automatic Control 50, 1812-1816")
LEVANT_2020 = Source("A. Levant and M. Livne", 2020,
                     "Robust exact filtering differentiators",
                     "European Journal of Control 55, 33-44")
LIVNE_2014 = Source("M. Livne and A. Levant", 2014,
                    "Proper discretization of homogeneous differentiators",
                    "Automatica 50, 2007-2014")
PLESTAN_2010 = Source("F. Plestan, Y. Shtessel, V. Bregeault and A. Poznyak", 2010,
                      "New methodologies for adaptive sliding mode control",
                      "International Journal of Control 83, 1907-1919")
QUANSER = Source("Quanser", None, "Qube-Servo 3 User Manual", "Quanser")
SEEBER_2017 = Source("R. Seeber and M. Horn", 2017,
                     "Stability proof for a well-established super-twisting parameter setting",
                     "Automatica 84, 241-243")
SHTESSEL_2012 = Source("Y. Shtessel, M. Taleb and F. Plestan", 2012,
                       "A novel adaptive-gain supertwisting sliding mode controller: "
                       "methodology and application", "Automatica 48, 759-769")
SHTESSEL_2014 = Source("Y. Shtessel, C. Edwards, L. Fridman and A. Levant", 2014,
                       "Sliding Mode Control and Observation", "Birkhauser")
SHTESSEL_2017 = Source("Y. Shtessel, J. A. Moreno and L. M. Fridman", 2017,
                       "Twisting sliding mode control with adaptation: Lyapunov design, "
                       "methodology and application", "Automatica 75, 229-235")
SLOTINE_1991 = Source("J.-J. E. Slotine and W. Li", 1991, "Applied Nonlinear Control",
                      "Prentice Hall")
UTKIN_1992 = Source("V. I. Utkin", 1992, "Sliding Modes in Control and Optimization", "Springer")
UTKIN_1996 = Source("V. I. Utkin and J. Shi", 1996,
                    "Integral sliding mode in systems operating under uncertainty conditions",
                    "35th IEEE Conference on Decision and Control, 4591-4596")

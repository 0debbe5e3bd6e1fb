"""Numbers that others have printed, and those of studies made apart from this code; never this
code's own output.

"The paper": "Aerospace Sliding Mode Control Toolbox: Relative Degree Approach with Resource
Prospector Lander and Launch Vehicle Case Studies". Tolerances are relative and follow from the
digits printed, unless a row says otherwise.
"""

from collections import namedtuple

Row = namedtuple("Row", "source case value tolerance")

#: Sliding variables: case (relative degree, settling time [s]); value (c_0, c_-1).
SLIDING_VARIABLES = [
    Row("paper (48)", (2, 2.0), (7.0, 25.0), 1e-12),
    Row("paper (49)", (2, 5.0), (2.8, 4.0), 1e-12),
    Row("paper (69)", (2, 8.0), (1.75, 1.56), 2e-3),
    Row("paper (69), before rounding", (2, 8.0), (1.75, 1.5625), 1e-12),
]

#: ITAE polynomials, descending, by degree.
ITAE = [
    Row("Graham and Lathrop 1953", 1, (1, 1), 0),
    Row("Graham and Lathrop 1953", 2, (1, 1.4, 1), 0),
    Row("Graham and Lathrop 1953", 3, (1, 1.75, 2.15, 1), 0),
    Row("Graham and Lathrop 1953", 4, (1, 2.1, 3.4, 2.7, 1), 0),
    Row("Graham and Lathrop 1953", 5, (1, 2.8, 5.0, 5.5, 3.4, 1), 0),
    Row("Graham and Lathrop 1953", 6, (1, 3.25, 6.6, 8.6, 7.45, 3.95, 1), 0),
]

#: Launch vehicle, transfer function (7): numerator and denominator, descending.
TRANSFER_FUNCTION = Row("paper (7)", "numerator, denominator",
                        ((-117.1, -13.55, -16870.0),
                         (0.2, 3.425, 72.39, 679.0, 6364.0, 22230.0, -2557.0, -9000.0)), 0)

#: Launch vehicle, the combinations of parameters that the dynamics depend on. The paper's (7) holds
#: for the set in US units (I = 1e8 slug ft^2, R = 1e6 lbf, q = 1000 psf, S = 100 ft^2, l_a = 50 ft,
#: l_g = 75 ft, S_n = 100 slug ft, I_n = 1000 slug ft^2): the values follow from these by hand.
DYNAMICS = [
    Row("US units behind (7)", "a = C_Na q S l_a/I", 8.0*1000*100*50/1e8, 1e-4),
    Row("US units behind (7)", "K = l_g R/I", 75*1e6/1e8, 1e-4),
    Row("US units behind (7)", "J = (l_g S_n + I_n)/I", (75*100 + 1000)/1e8, 1e-4),
    Row("US units behind (7)", "c_2 = psi_s (S_n phi_g - I_n psi_g)", 1e-4*(100*-5e-4 - 1000*1e-4),
        1e-3),
    Row("US units behind (7)", "c_0 = psi_s R phi_g", 1e-4*1e6*-5e-4, 1e-3),
]

#: Launch vehicle, practical relative degree of (7), and the step of its fifth derivative per unit
#: of input, a_2/b_7.
PRD = Row("paper, PRD ID: algorithm verification", "eq (7)", 5, 0)
HIGH_FREQUENCY_GAIN = Row("paper (7)", "a_2/b_7", -117.1/0.2, 1e-12)

#: Lander, vector practical relative degree of attitude and altitude.
LANDER_PRD = Row("paper, RPL SMC design, step 1", "(theta, x)", (2, 2), 0)

#: Lander, dead bands: {channel: (begin [s], end [s], delta)}.
TABLE_1 = Row("paper Table 1", "dead bands",
              dict(attitude=((0, 100, 0.05), (100, 200, 0.025), (200, 240, 0.01)),
                   descent=((0, 100, 0.1), (100, 200, 0.075), (200, 240, 0.05))), 0)

#: Lander, Table 2: value (J_ea, J_ed [m], J_ua [N], J_ud [N]). The unit of J_ea is not given; no
#: J_ud can be had at all.
TABLE_2 = {
    "PID": Row("paper Table 2", "PID", (0.5855, 336.6, 5.304, 10220.0), 0),
    "STW": Row("paper Table 2", "STW", (0.0463, 3.427, 3.054, 2552.0), 0),
    "1-SMC": Row("paper Table 2", "1-SMC", (0.1234, 66.58, 5.206, 1513.0), 0),
}

PD_GAINS = [Row("paper (67)", "k_p", 1.87, 3e-3),
            Row("paper (67), with damping 0.8 instead of its 0.7", "k_d", 2.13, 3e-3)]

#: Table 3: case; value (J_e, J_u). None can be had on the paper's own plant with its own
#: perturbation.
TABLE_3 = [
    Row("paper Table 3", "PD", (0.04885, 0.1119), 0),
    Row("paper Table 3", "STW", (0.001371, 0.09041), 0),
    Row("paper Table 3", "1-SMC", (0.001602, 0.01462), 0),
]

# ---- an independent study of the launch vehicle: another program, another order of operations, gai
Case = namedtuple("Case", "law preset J_e J_u weak strong calm coarse fine within")

#: 30 s, dt = 1e-4 s, command (68), perturbation (72). J_e; J_u; J_e with the plant's gain x 0.8, x
#: 1.2; J_e without the perturbation; J_e with dt = 1e-3, 1e-5 s; and the relative tolerance of J_e
#: (J_u: 1 %).
RECOMMENDED = [
    Case("pd", "recommended", 0.1915, 0.3704, 0.212, 0.180, 0.0058, 0.1915, 0.1915, 0.01),
    Case("quasi_smc", "eq69", 0.00740, 0.2752, 0.0131, 0.0059, 0.0043, 0.00743, 0.00739, 0.01),
    Case("quasi_smc", "itae2", 0.00507, 0.2700, 0.0054, 0.0047, 0.0037, 0.00508, 0.00507, 0.01),
    Case("quasi_smc", "r3", 0.00524, 0.2677, 0.0053, 0.0052, 0.0047, 0.00524, 0.00524, 0.01),
    Case("adaptive_super_twisting", "eq69", 0.00518, 0.2774, 0.0070, 0.0074, 0.0066, 0.00511,
         0.00517, 0.03),
    Case("adaptive_super_twisting", "itae2", 0.00423, 0.2671, 0.0045, 0.0052, 0.0044, 0.00418,
         0.00422, 0.03),
    Case("adaptive_super_twisting", "r3", 0.00539, 0.2675, 0.0046, 0.0053, 0.0047, 0.00513, 0.00541,
         0.03),
    Case("hosm", "recommended", 0.00399, 0.2674, 0.0037, 0.0043, 0.0037, 0.00398, 0.00399, 0.03),
    Case("hosm", "r3", 0.00403, 0.2672, 0.0044, 0.0041, 0.0043, 0.00410, 0.00403, 0.03),
    Case("hosm", "raised", 0.00657, 0.2690, 0.0063, 0.0067, 0.0057, 0.00717, 0.00650, 0.03),
]

#: The same study, more of HOSM: greatest u [rad], its variation per second in the last 10 s, J_e
#: with twice the perturbation, J_e of the pitch angle alone (differentiator of order n_d, L = 10).
#: Relative tolerance 3 %.
Hosm = namedtuple("Hosm", "preset max_u variation twice n_d measured")
HOSM = [Hosm("recommended", 0.404, 0.107, 0.0052, 2, 0.00399),
        Hosm("r3", 0.411, 0.210, 0.0090, 3, 0.00403),
        Hosm("raised", 0.422, 0.294, 0.150, 3, 0.00658)]

#: The same study, quasi-SMC on (69), the error and its rate from a differentiator of order 2 of e:
#: L; J_e, None where it diverges. Relative tolerance 3 %.
DIFFERENTIATED = [(1.0, None), (10.0, 0.0080), (100.0, 0.0070)]

#: The same study, changes of the recommended HOSM design: J_e. Relative tolerance 3 %, as far as
#: the digits go.
HOSM_CHANGED = [
    (dict(L=0.15), 0.0057), (dict(L=0.6), 0.0068),
    # the paper's power
    (dict(alpha_r=0.75, gamma_1=0.25, gamma_2=0.5, L=0.25, r_0=0.15, eps=0.007, tau_f=1.3), 0.0046),
]

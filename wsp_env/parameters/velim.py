"""The braking tests at Velim (Czech Republic) on a track sprayed with a watery detergent solution.

Source: Meli, Ridolfi et al., "Development of an innovative wheel-rail contact model for the analysis of degraded
adhesion in railway systems" (the seed paper), Tables 2, 3, 4 and 7 and section 4.1. The recordings are not public.
What this set does not claim: the contact ellipse and c11 (see `ContactParameters`).
"""

from wsp_env.parameters.contact import ContactParameters

#: Table 2.
CONTACT = ContactParameters()

#: Recovery rate tau [m/J] that the paper tuned on group A, section 4.1; of one wheel with its own load, as W_sp is.
TAU_M_PER_J = 1.9e-4

#: Initial speeds [m/s] of the six tests, Table 3: group A was tuned on, group B validated.
TEST_SPEEDS_MPS = {"A1": 42.3, "A2": 40.4, "A3": 40.8, "B1": 40.8, "B2": 41.1, "B3": 41.8}

#: Relative error e_1 [-] of the adhesion coefficient of the first wheel, Table 4.
ADHESION_ERRORS = {"A1": 0.038, "A2": 0.043, "A3": 0.033, "B1": 0.051, "B2": 0.048, "B3": 0.045}

#: Sample time of the recordings [s], section 3.2.
SAMPLE_TIME_S = 0.01

#: Table 7: largest error E_1 of the simulated vehicle speed [m/s].
SPEED_ERRORS_MPS = {"A1": 2.05, "A2": 0.90, "A3": 1.84, "B1": 1.51, "B2": 0.91, "B3": 1.68}

#: Table 7: mean slide of the first wheel [m/s], recorded and simulated.
MEAN_SLIDES_MPS = {
    "A1": (5.00, 5.61), "A2": (5.25, 4.96), "A3": (4.23, 4.61), "B1": (5.49, 5.14), "B2": (5.41, 5.30), "B3": (5.83, 5.73),
}  # fmt: skip

#: Table 7: standard deviation of the slide of the first wheel [m/s], recorded and simulated.
SLIDE_DEVIATIONS_MPS = {
    "A1": (1.72, 1.49), "A2": (2.19, 1.79), "A3": (1.59, 1.59), "B1": (1.75, 1.58), "B2": (1.77, 1.45), "B3": (1.78, 1.84),
}  # fmt: skip

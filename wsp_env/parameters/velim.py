"""The braking tests at Velim (Czech Republic) on a track sprayed with a watery detergent solution.

Source: Meli, Ridolfi et al., "Development of an innovative wheel-rail contact model for the analysis of degraded
adhesion in railway systems" (the seed paper), Tables 2, 3 and 4 and section 4.1. The recordings are not public.
What this set does not claim: the contact ellipse and c11 (see `ContactParameters`).
"""

from wsp_env.parameters.contact import ContactParameters

#: Table 2.
CONTACT = ContactParameters()

#: Recovery rate tau [m/J] that the paper tuned on group A, section 4.1.
TAU_M_PER_J = 1.9e-4

#: Initial speeds [m/s] of the six tests, Table 3: group A was tuned on, group B validated.
TEST_SPEEDS_MPS = {"A1": 42.3, "A2": 40.4, "A3": 40.8, "B1": 40.8, "B2": 41.1, "B3": 41.8}

#: Relative error e_1 [-] of the adhesion coefficient of the first wheel, Table 4.
ADHESION_ERRORS = {"A1": 0.038, "A2": 0.043, "A3": 0.033, "B1": 0.051, "B2": 0.048, "B3": 0.045}

#: Sample time of the recordings [s], section 3.2.
SAMPLE_TIME_S = 0.01

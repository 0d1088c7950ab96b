"""The proof of the diagnosis: campaigns in which an effect is concealed, and the score of what is found in them.

The truth model (`truth`, `setup`, `effects`, `sensors`, `campaign`, `faults`, `interest`) shares no code with `wsp_env`: other
equations wherever the literature offers a choice, another integrator, another WSP. The bank (`plan`, `bank`) draws cases
from it and keeps those that the seed paper's own validation lets pass (`concealment`). `diagnoses` (`answers`, `distances`)
runs the released diagnosis over them, `outside` over campaigns that somebody else made, `rivals` (with `black_box`) answer in
simpler ways. `truths` reads labels of both kinds, `promised` counts the figures that all campaigns have, `score` those of the
bank, `required` compares them with what has to be shown, `page` (with `figures`) puts them into docs/concealed*.md.
`python -m experiments.concealed` does all of the bank but the page.
"""

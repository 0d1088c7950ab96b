"""The proof of the diagnosis: campaigns in which an effect is concealed, and the score of what is found in them.

The truth model (`truth`, `setup`, `effects`, `sensors`, `campaign`, `interest`) shares no code with `wsp_env`: other
equations wherever the literature offers a choice, another integrator, another WSP. The bank (`plan`, `bank`) draws cases
from it and keeps those that the seed paper's own validation lets pass (`concealment`). `diagnoses` (with `distances`) runs the
released diagnosis over them, `rivals` (with `black_box`) answer in simpler ways, `score` compares answers with labels,
`required` with what has to be shown, `page` (with `figures`) puts it into docs/concealed.md.
`python -m experiments.concealed` does all but the page.
"""

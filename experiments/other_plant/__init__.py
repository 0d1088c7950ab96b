"""A second, independent simulator of braked vehicles on a contaminated rail, against which controllers are tested.

It shares with `wsp_env` only the nominal vehicles (`wsp_env.parameters`) and the `Measurement` that a controller gets. The
contact law is that of docs/contact.md, solved in its own way; brake, sensors and integrator are of another form than a
textbook's: valves with stroke and orifice flow, a distributor with inshot, hysteresis, pads whose friction falls with speed,
pulse wheels.
`draw.draw` makes the stops of a world, `run.brake` brakes them under a controller and returns figures.
"""

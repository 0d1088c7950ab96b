"""Controllers without learning, to compare against.

Here belong: a rule-based wheel slide protection in the style of EN 15595 (deceleration and slip thresholds, apply / hold /
vent), slip control, no protection at all, and the bound that no controller can beat. A controller sees measurements only
(`wsp_env.plant.port.Measurement`) and knows its own commands.
"""

"""Estimation of vehicle and rail state from the vehicle's own sensors and commands, and the observation built from it."""

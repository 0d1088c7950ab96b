"""Training of learned controllers with Stable-Baselines3, and their export; not part of the installed package."""

import os

# Before torch is loaded: threads that wait for work sleep. Where several trainings share a machine they would otherwise spin in
# each other's way, at a sixth of the speed.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

"""Training of learned controllers with Stable-Baselines3, and their export; not part of the installed package."""

"""Measured data from elsewhere: an effect is left out of the model, and the search of the diagnosis has to find it."""

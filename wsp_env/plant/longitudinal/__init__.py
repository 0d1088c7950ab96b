"""Today's plant: the longitudinal motion of a vehicle and the turning of its wheelsets, forwards and along a recording."""

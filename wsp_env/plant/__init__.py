"""What a braked vehicle does in one time step: wheelsets, brake, track, sensors, mechanisms."""

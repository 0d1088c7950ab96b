"""What a vehicle can know of itself and its rail from its own sensors and commands, and the observation made of it."""

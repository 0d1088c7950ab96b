"""What two bodies do at one point: Hertz, Kalker, Polach, FASTSIM, the degraded-adhesion law."""

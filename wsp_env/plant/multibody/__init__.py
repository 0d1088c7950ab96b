"""The 3D plant: carbody, two bogies, wheelsets and axle boxes on suspensions and on a multi-contact wheel-rail pair."""

"""Where wheel and rail touch: profiles, wheelset on track, contact points, and the forces of each contact."""

"""Controllers of the wheel slide protection, the test programme they go through and their figures of merit."""

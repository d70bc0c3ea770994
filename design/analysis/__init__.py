"""What can be said of a closed loop: trajectories, sensitivities, estimates, and verdicts."""

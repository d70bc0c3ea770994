"""MPC versus PD: is a constrained MPC worth it over three well-chosen gains, and where."""

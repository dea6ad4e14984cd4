"""Objects, movements and data sets for the simulated finger."""

"""Data sets, simulation, training and scores: nothing that feeling needs."""

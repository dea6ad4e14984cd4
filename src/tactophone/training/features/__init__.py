"""Feature-based detectors: feature tracks, training sets, linear classifiers and baselines."""

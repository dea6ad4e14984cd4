"""Training of detectors: recipes, features, the paper's network, fine-tuning, model
files."""

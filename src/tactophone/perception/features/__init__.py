"""Windows of sound to feature vectors."""

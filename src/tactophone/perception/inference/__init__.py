"""The engine that runs model files."""

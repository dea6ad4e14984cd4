"""Recordings with their labels, surfaces and splits."""

"""Metrics, scores and figures: every number with its definition."""

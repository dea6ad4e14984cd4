"""Metrics, intervals, event metrics and reports: every number with its definition."""

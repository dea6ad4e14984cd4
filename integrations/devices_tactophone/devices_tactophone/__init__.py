"""Devices of others, each driven by its documented protocol."""

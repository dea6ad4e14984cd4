"""Threads, processes, clocks and devices of the live system: the only room that reads
the time."""

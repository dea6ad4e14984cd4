"""The time of the stages: threads, processes, clock and devices wired to the pipeline; start and stop."""

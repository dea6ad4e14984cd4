"""The only floor with clocks and threads: devices, processes, telemetry and the log of
a run."""

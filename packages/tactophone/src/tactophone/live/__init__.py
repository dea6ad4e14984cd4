"""What happens in real time: devices, processes and their clocks, telemetry and the log
of a run."""

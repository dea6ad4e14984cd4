"""Stand-ins for hardware, network and people that keep the real contracts."""

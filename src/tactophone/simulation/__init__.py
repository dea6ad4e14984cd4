"""Surface, finger, room, network and operator: stand-ins that pass the real contracts."""

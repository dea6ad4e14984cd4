"""Surface, finger, contact, room and microphones."""

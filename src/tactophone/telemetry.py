"""What may be watched: counters and the latest tick; nothing ever waits for a watcher."""

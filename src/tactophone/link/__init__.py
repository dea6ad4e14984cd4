"""Sound over the network: codec, packets, sealed sessions, arrival, playout and statistics."""

"""Sound over the network: codec, packets, encrypted sessions, playout and
statistics."""

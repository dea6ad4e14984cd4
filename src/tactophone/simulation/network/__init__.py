"""Impaired networks, in virtual time and between real sockets."""

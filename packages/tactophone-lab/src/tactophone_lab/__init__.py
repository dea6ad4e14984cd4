"""Data sets, simulation, training and scores. The package `tactophone` needs none of
it to feel, send, receive and replay."""

# Switches off what ONNX Runtime reports to its maker, before a module here imports it.
import tactophone  # noqa: F401

"""Data sets, simulation, training and scores: nothing that feeling needs."""

# Switches off what ONNX Runtime reports to its maker, before a module here imports it.
import tactophone  # noqa: F401

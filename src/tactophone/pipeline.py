"""The order of the stages, and nothing else: no thread, clock or device."""

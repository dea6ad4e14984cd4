"""The stone box: find the two rough stones of five by touch alone, in a browser."""

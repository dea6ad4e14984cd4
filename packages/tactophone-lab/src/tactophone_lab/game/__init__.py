"""The stone box: find the rough ones of five hidden stones by touch alone."""

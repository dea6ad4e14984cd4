"""Sound to belief: resample, window, judge, decide."""

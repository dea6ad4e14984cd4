"""Sound to prediction: resample, window, extract features, classify, decide; and the health of the microphones."""

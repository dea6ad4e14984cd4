"""Sound to prediction: resample, window, run the model, decide; and the health of the
microphones."""

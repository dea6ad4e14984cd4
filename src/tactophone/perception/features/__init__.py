"""Features of windows of sound: resampling, windows, bands, spectra, waveform shapes."""

"""Sources of sound: microphones behind JACK and PortAudio, and files; all obey `tactophone.types.Source`."""

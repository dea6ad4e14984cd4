"""Sound in: microphones behind JACK and PortAudio, and files, under one contract (`tactophone.types.Source`)."""

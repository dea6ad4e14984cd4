"""Sound devices that come and go: JACK clients, PortAudio streams, a clocked device, and a survey of them."""

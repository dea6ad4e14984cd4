"""The guided recorder: the paper's protocol, a writer that loses nothing, and a check of each take."""

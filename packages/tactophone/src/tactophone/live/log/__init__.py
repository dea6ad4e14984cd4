"""The log of a run: MCAP files, their topics, and the reader of a run that feeds
them."""

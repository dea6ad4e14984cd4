"""What several verbs share: options, consoles, sources and summaries."""

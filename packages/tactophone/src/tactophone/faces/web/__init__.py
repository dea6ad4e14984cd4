"""Pages in a browser: the operator's page, the page of a guided command, and the stone
box; each in its own process."""

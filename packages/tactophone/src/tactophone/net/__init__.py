"""Sound across a network: the encrypted link, calls through routers, and the order of
both ends."""

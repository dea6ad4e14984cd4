"""Calls through two routers: a spoken code finds the other end, ICE the path, and a
relay helps."""

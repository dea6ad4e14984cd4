"""Calls through two routers: a spoken code finds the other end, ICE the way, and a
relay helps."""

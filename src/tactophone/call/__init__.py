"""Calls through two routers: a spoken code finds the other end, ICE finds the way, a relay helps where there is none.

All of it runs in a process of its own; the live processes get a socket, and import none of its libraries.
"""

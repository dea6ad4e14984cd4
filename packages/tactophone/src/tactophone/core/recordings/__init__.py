"""Recordings and their labels, as folders of other people hold them."""

"""A flow through time: in a window, in a browser, and as one page."""

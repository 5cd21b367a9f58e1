"""The viewer: the states of a flow in a window, in a browser, or as one page."""

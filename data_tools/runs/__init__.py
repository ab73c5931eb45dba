"""One recording, from its files to a folder of results."""

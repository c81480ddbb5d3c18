"""The command line: one file a verb, and `__main__` with the exit codes."""

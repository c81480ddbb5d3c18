"""The command line: one module per verb; `__main__` holds the parser and the exit codes."""

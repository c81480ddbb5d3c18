"""What was measured, as Markdown tables for the blocks of a page; one file for each source of results."""

"""What a user would reach for without this package: other methods, on the same rigs as the diagnosis."""

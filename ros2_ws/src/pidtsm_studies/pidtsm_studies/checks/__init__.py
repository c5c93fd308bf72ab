"""The page about what was understood of an arm."""

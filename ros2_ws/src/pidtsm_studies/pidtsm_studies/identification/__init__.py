"""The result of an identification as a page and as plain data."""

"""What theory says of a set of gains, and how far a run keeps to it."""

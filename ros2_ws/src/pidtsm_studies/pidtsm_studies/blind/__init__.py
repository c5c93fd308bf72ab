"""Arms with seeded faults: to practise on, and to judge what finds faults."""

"""Shared code of the pidtsm nodes: parameters, joint order, stamps, quality of service, life cycle and main loop."""
